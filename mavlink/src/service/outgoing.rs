//! Messages that are sent without a request: heartbeats, `EFI_STATUS`, named values, texts of events, and the request for
//! the rate of the autopilot's outputs.

use super::{Place, Service};
use crate::attached::{Attached, Channels, sealed::Streams};
use crate::dialect::{COMMAND_LONG_DATA, NAMED_VALUE_FLOAT_DATA, RC_CHANNELS_DATA, RELAY_STATUS_DATA};
use crate::ids::{
    CMD_SET_MESSAGE_INTERVAL, COMPONENT_AUTOPILOT, MESSAGE_RC_CHANNELS, MESSAGE_RELAY_STATUS,
    MESSAGE_SERVO_OUTPUT_RAW, Severity,
};
use crate::port::Class;
use crate::report::{efi_status, heartbeat, named_values, node_heartbeat};
use crate::settings::DemandSource;
use crate::text::severity;
use embassy_sync::pubsub::WaitResult;
use embassy_time::{Duration, Instant};
use jetlink::units::{Verbatim, Whole};
use mavlink_core::types::CharArray;

/// Interval on a port that carries everything.
const WIDE_EVERY: Duration = Duration::from_millis(100);
const VALUES_EVERY: Duration = Duration::from_secs(1);
const RELAYS_EVERY: Duration = Duration::from_secs(1);
/// `MAV_EFI_ENGINE` for all engines.
const ALL: u8 = 255;

impl<const N: usize, const P: usize, A: Attached> Service<'_, N, P, A> {
    pub(super) fn report_events(&mut self, now: Instant, place: usize) {
        loop {
            let event =
                self.engines.get_mut(place).and_then(|engine| engine.events.as_mut()?.try_next_message());
            match event {
                Some(WaitResult::Message(event)) => {
                    if let Some(severity) = severity(&event) {
                        self.say(now, Place::Engine(place), severity, None, format_args!("{event}"));
                    }
                }
                Some(WaitResult::Lagged(lost)) => {
                    let lost = u32::try_from(lost).unwrap_or(u32::MAX);
                    self.counters.events_lost = self.counters.events_lost.wrapping_add(lost);
                }
                None => return,
            }
        }
    }

    /// Reports changed outputs, and sends the streams of the attached devices.
    pub(super) fn report_attached(&mut self, now: Instant) {
        let mut changed = false;
        while let Some(change) = self.attached.next_change() {
            changed = true;
            let severity = if change.alarming { Severity::Critical } else { Severity::Notice };
            let what = format_args!("{}: {}", Verbatim(change.what), Verbatim(change.why));
            self.say(now, Place::Engine(change.engine), severity, None, what);
        }
        let has_outputs = self.attached.has_outputs();
        for port in 0..P {
            let Some(streams) = self.streams.get_mut(port) else { continue };
            let mut due = |message, default| {
                streams.schedule(message).is_some_and(|schedule| schedule.is_due(now, default))
            };
            let relays = has_outputs && due(MESSAGE_RELAY_STATUS, Some(RELAYS_EVERY));
            // On request only: a ground station would take them for the autopilot's channels.
            let channels = due(MESSAGE_RC_CHANNELS, None);
            if relays || changed && has_outputs {
                self.send_relays(now, port, Class::Telemetry);
            }
            if channels {
                self.send_channels(now, port, Class::Telemetry);
            }
        }
    }

    /// Two relays for each engine: its fuel valve, and the power of its starter and ignition.
    pub(super) fn send_relays(&mut self, now: Instant, port: usize, class: Class) {
        let (mut on, mut present) = (0_u16, 0_u16);
        let mut bit = 1_u16;
        for engine in 0..self.engines.len() {
            let outputs = self.attached.outputs(engine);
            for output in [outputs.valve, outputs.power] {
                present |= if output.is_some() { bit } else { 0 };
                on |= if output == Some(true) { bit } else { 0 };
                bit = bit.checked_shl(1).unwrap_or(0);
            }
        }
        let message = RELAY_STATUS_DATA { time_boot_ms: self.since_start(now), on, present };
        self.send(now, port, Place::Node, class, &message);
    }

    /// Channels of the receiver, where there is one.
    pub(super) fn send_channels(&mut self, now: Instant, port: usize, class: Class) {
        let Some(channels) = self.attached.channels(now) else { return };
        let quality = self.attached.link_quality(now);
        let message = rc_channels(self.since_start(now), &channels, quality);
        self.send(now, port, Place::Node, class, &message);
    }

    /// Time since the start, ms; wraps after 49 days.
    fn since_start(&self, now: Instant) -> u32 {
        now.saturating_duration_since(self.started).as_millis() as u32
    }

    pub(super) fn report_lost_texts(&mut self, now: Instant) {
        if let Some(lost) = self.node_texts.take_lost(now).map(Whole) {
            self.say(now, Place::Node, Severity::Notice, None, format_args!("{lost} texts were lost"));
        }
        for place in 0..self.texts.len() {
            if let Some(lost) =
                self.texts.get_mut(place).and_then(|limiter| limiter.take_lost(now)).map(Whole)
            {
                self.say(
                    now,
                    Place::Engine(place),
                    Severity::Notice,
                    None,
                    format_args!("{lost} texts were lost"),
                );
            }
        }
    }

    pub(super) fn send_heartbeat(&mut self, now: Instant, port: usize, place: Place) {
        let message = match place {
            Place::Node => node_heartbeat(self.fleet(), self.has_to_be_confirmed()),
            Place::Engine(place) => {
                let Some(engine) = self.engines.get(place) else { return };
                heartbeat(&engine.telemetry(), engine.is_at_run())
            }
        };
        self.send(now, port, place, Class::Always, &message);
    }

    /// Sends the counters of frames ignored because of their signature: one a second, those above 0 in turn.
    pub(super) fn send_signing(&mut self, now: Instant) {
        if !cfg!(feature = "signing") {
            return;
        }
        let counters = self.counters.signing.named();
        let ahead = counters.into_iter().enumerate().cycle().skip(usize::from(self.signing_sent) + 1);
        let next = ahead.take(counters.len()).find(|(_, (_, count))| *count > 0);
        let Some((sent, (name, count))) = next else { return };
        self.signing_sent = sent as u8; // 7 of them
        for port in 0..self.ports.len() {
            self.send_value(now, port, Place::Node, Class::Telemetry, name, count as f32);
        }
    }

    pub(super) fn send_all_telemetry(&mut self, now: Instant) {
        for port in 0..self.ports.len() {
            for offset in 0..self.engines.len() {
                let engine = (self.first + offset) % self.engines.len().max(1);
                self.send_telemetry(now, port, engine);
            }
        }
        self.first = (self.first + 1) % self.engines.len().max(1);
    }

    /// Whether an engine's `EFI_STATUS` may be sent on a port: the autopilot gets that of one engine.
    pub(super) fn sends_efi(&self, port: usize, engine: usize) -> bool {
        match self.settings.efi_engine {
            _ if self.autopilot_port != Some(port) => true,
            ALL => true,
            chosen => usize::from(chosen) == engine + 1,
        }
    }

    fn send_telemetry(&mut self, now: Instant, port: usize, engine: usize) {
        let to_autopilot = self.autopilot_port == Some(port);
        let settings = &self.settings;
        let sent = self.sends_efi(port, engine);
        let Some(out) = self.ports.get_mut(port) else { return };
        let wide = out.config.is_wide() && !to_autopilot;
        let every = if wide { WIDE_EVERY } else { settings.efi_interval };
        let Some(streams) = out.streams.get_mut(engine) else { return };
        let efi = streams.efi.is_due(now, Some(every)) && sent;
        let values = streams.values.is_due(now, Some(if wide { WIDE_EVERY } else { VALUES_EVERY }));
        if efi {
            self.send_efi(now, port, engine, Class::Telemetry);
        }
        if values {
            self.send_values(now, port, engine, !sent, Class::Telemetry);
        }
    }

    pub(super) fn send_efi(&mut self, now: Instant, port: usize, place: usize, class: Class) {
        let Some(engine) = self.engines.get(place) else { return };
        let message = efi_status(place, &engine.telemetry());
        self.send(now, port, Place::Engine(place), class, &message);
    }

    pub(super) fn send_values(
        &mut self,
        now: Instant,
        port: usize,
        place: usize,
        with_main: bool,
        class: Class,
    ) {
        let Some(engine) = self.engines.get(place) else { return };
        let telemetry = engine.telemetry();
        let streams = self.ports.get_mut(port).and_then(|port| port.streams.get_mut(place));
        let quality = streams.and_then(|streams| streams.quality.percent(now, &telemetry.counters));
        for (name, value) in named_values(&telemetry, quality, with_main) {
            self.send_value(now, port, Place::Engine(place), class, name, value);
        }
    }

    fn send_value(&mut self, now: Instant, port: usize, place: Place, class: Class, name: &str, value: f32) {
        let since = now.saturating_duration_since(self.started).as_millis();
        let message = NAMED_VALUE_FLOAT_DATA {
            time_boot_ms: since as u32, // wraps after 49 days
            value,
            name: value_name(name, place.engine()),
        };
        self.send(now, port, place, class, &message);
    }

    /// Requests the autopilot's outputs if an engine follows them.
    pub(super) fn request_rate(&mut self, now: Instant) {
        let follows = self.engines.iter().any(|it| it.settings.demand_source() == DemandSource::ServoOutput);
        let (true, Some(port), Some(system)) = (follows, self.autopilot_port, self.vehicle.id()) else {
            return;
        };
        let Some(interval) = self.request.due(now, self.vehicle.is_received(now)) else { return };
        let message = COMMAND_LONG_DATA {
            param1: MESSAGE_SERVO_OUTPUT_RAW as f32,
            param2: interval.as_micros() as f32,
            param3: 0.0,
            param4: 0.0,
            param5: 0.0,
            param6: 0.0,
            param7: 0.0,
            command: CMD_SET_MESSAGE_INTERVAL,
            target_system: system,
            target_component: COMPONENT_AUTOPILOT,
            confirmation: 0,
        };
        self.send(now, port, Place::Node, Class::Answer, &message);
    }
}

/// Channels of a receiver as a message. 65535 is a channel without a value. The signal strength is 254 if all frames of the link
/// arrive, and 255 if that is unknown.
fn rc_channels(time_boot_ms: u32, channels: &Channels, quality: Option<u8>) -> RC_CHANNELS_DATA {
    let rssi = quality.map_or(u8::MAX, |percent| (u16::from(percent.min(100)) * 254 / 100) as u8);
    let [c1, c2, c3, c4, c5, c6, c7, c8, c9, c10, c11, c12, c13, c14, c15, c16, c17, c18] =
        channels.map(|channel| channel.unwrap_or(u16::MAX));
    let count = channels.iter().rposition(Option::is_some).map_or(0, |last| last + 1);
    RC_CHANNELS_DATA {
        time_boot_ms,
        chan1_raw: c1,
        chan2_raw: c2,
        chan3_raw: c3,
        chan4_raw: c4,
        chan5_raw: c5,
        chan6_raw: c6,
        chan7_raw: c7,
        chan8_raw: c8,
        chan9_raw: c9,
        chan10_raw: c10,
        chan11_raw: c11,
        chan12_raw: c12,
        chan13_raw: c13,
        chan14_raw: c14,
        chan15_raw: c15,
        chan16_raw: c16,
        chan17_raw: c17,
        chan18_raw: c18,
        chancount: count as u8, // 18 at most
        rssi,
    }
}

/// Name of a named value: 10 bytes, with the engine's number from 1 at its end, if it is of an engine.
fn value_name(name: &str, engine: Option<usize>) -> CharArray<10> {
    let mut bytes = [0; 10];
    let number = engine.map(|engine| b'1'.saturating_add(engine as u8));
    bytes.iter_mut().zip(name.bytes().take(9).chain(number)).for_each(|(slot, byte)| *slot = byte);
    CharArray::new(bytes)
}
