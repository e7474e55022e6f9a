//! What is sent without a request: heartbeats, `EFI_STATUS`, named values, texts of events, and the request for the rate of
//! the autopilot's outputs.

use super::{Place, Service};
use crate::dialect::{COMMAND_LONG_DATA, NAMED_VALUE_FLOAT_DATA};
use crate::ids::{CMD_SET_MESSAGE_INTERVAL, COMPONENT_AUTOPILOT, MESSAGE_SERVO_OUTPUT_RAW, Severity};
use crate::port::Class;
use crate::report::{efi_status, heartbeat, named_values, node_heartbeat};
use crate::settings::DemandSource;
use crate::text::severity;
use embassy_sync::pubsub::WaitResult;
use embassy_time::{Duration, Instant};
use mavlink_core::types::CharArray;

const HEARTBEAT_EVERY: Duration = Duration::from_secs(1);
/// Bytes of a heartbeat that is not signed.
const HEARTBEAT_BYTES: usize = 21;
/// On a port that carries everything.
const WIDE_EVERY: Duration = Duration::from_millis(100);
const VALUES_EVERY: Duration = Duration::from_secs(1);
/// `MAV_EFI_ENGINE` for all engines.
const ALL: u8 = 255;

impl<const N: usize, const P: usize> Service<'_, N, P> {
    pub(super) fn tick(&mut self, now: Instant) {
        for port in 0..self.ports.len() {
            self.ports.get_mut(port).into_iter().for_each(|port| port.decoder.look_after());
            self.receive(now, port, &[]);
        }
        for place in 0..self.engines.len() {
            let Some(engine) = self.engines.get_mut(place) else { continue };
            if let Some(why) = engine.update(Self::situation(now, &self.vehicle, &self.received)) {
                self.say_not_started(now, place, why);
            }
            self.report_events(now, place);
            self.report_progress(now, place, now >= self.next_heartbeat);
        }
        self.report_lost_texts(now);
        if now >= self.next_heartbeat {
            self.next_heartbeat = now + HEARTBEAT_EVERY;
            self.send_signing(now);
            for port in 0..self.ports.len() {
                self.send_heartbeat(now, port, Place::Node);
                (0..self.engines.len())
                    .for_each(|engine| self.send_heartbeat(now, port, Place::Engine(engine)));
            }
        }
        self.request_rate(now);
        for port in 0..self.ports.len() {
            for offset in 0..self.engines.len() {
                let engine = (self.first + offset) % self.engines.len().max(1);
                self.send_telemetry(now, port, engine);
            }
        }
        self.first = (self.first + 1) % self.engines.len().max(1);
    }

    fn report_events(&mut self, now: Instant, place: usize) {
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

    fn report_lost_texts(&mut self, now: Instant) {
        if let Some(lost) = self.node_texts.take_lost(now) {
            self.say(now, Place::Node, Severity::Notice, None, format_args!("{lost} texts were lost"));
        }
        for place in 0..self.texts.len() {
            if let Some(lost) = self.texts.get_mut(place).and_then(|limiter| limiter.take_lost(now)) {
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
            Place::Node => node_heartbeat(self.fleet()),
            Place::Engine(place) => {
                let Some(engine) = self.engines.get(place) else { return };
                heartbeat(&engine.telemetry(), engine.is_at_run())
            }
        };
        let bytes = HEARTBEAT_BYTES + self.signing.overhead();
        if self.send(now, port, place, Class::Answer, &message)
            && let Some(port) = self.ports.get_mut(port)
        {
            port.charge(now, bytes);
        }
    }

    /// Sends what was ignored for its signature: one counter a second, those above 0 in turn.
    fn send_signing(&mut self, now: Instant) {
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

    fn send_telemetry(&mut self, now: Instant, port: usize, engine: usize) {
        let to_autopilot = self.autopilot_port == Some(port);
        let settings = &self.settings;
        let Some(out) = self.ports.get_mut(port) else { return };
        let wide = out.config.is_wide() && !to_autopilot;
        let sent = match settings.efi_engine {
            _ if !to_autopilot => true,
            ALL => true,
            chosen => usize::from(chosen) == engine + 1,
        };
        let every = if wide { WIDE_EVERY } else { settings.efi_interval };
        let Some(streams) = out.streams.get_mut(engine) else { return };
        let efi = streams.efi.is_due(now, sent.then_some(every));
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
        let quality = streams.and_then(|streams| streams.quality.percent(&telemetry.counters));
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

    /// Requests the autopilot's outputs, where an engine follows them.
    fn request_rate(&mut self, now: Instant) {
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

/// Name of a named value: 10 bytes, with the engine's number from 1 at its end, if it is of an engine.
fn value_name(name: &str, engine: Option<usize>) -> CharArray<10> {
    let mut bytes = [0; 10];
    let number = engine.map(|engine| b'1'.saturating_add(engine as u8));
    bytes.iter_mut().zip(name.bytes().take(9).chain(number)).for_each(|(slot, byte)| *slot = byte);
    CharArray::new(bytes)
}
