//! Received messages other than commands and parameters.

use super::{Place, Service};
use crate::attached::Attached;
use crate::dialect::*;
use crate::fields::{
    Fields, command, command_ack, command_cancel, heartbeat, param_request_list, param_request_read,
    param_set, rc_channels_override, servo_output_raw, setup_signing,
};
use crate::frame::{Address, Frame};
use crate::ids::{CMD_SET_MESSAGE_INTERVAL, Severity};
#[cfg(not(feature = "signing"))]
use crate::kind::Kind;
use crate::servo::throttle;
use crate::settings::DemandSource;
use crate::vehicle::{Arming, VehicleEvent};
use embassy_time::Instant;
use jetlink::units::{Verbatim, Whole};
use mavlink_core::MessageData;

impl<const N: usize, const P: usize, A: Attached> Service<'_, N, P, A> {
    /// Carries out a frame. `has_waited`: it has been admitted before.
    pub(super) fn handle(&mut self, now: Instant, port: usize, frame: Frame, has_waited: bool) {
        #[cfg(test)]
        self.handled.push((frame.id, frame.fields.all().to_vec()));
        let from = frame.from;
        // Our own frames may come back.
        let own = self.system(now, port);
        if own == Some(from.system) && self.place(from.component).is_some() {
            return;
        }
        let fields = &frame.fields;
        let target = |at| Address { system: fields.u8(at), component: fields.u8(at + 1) };
        if frame.id == SETUP_SIGNING_DATA::ID {
            let target = target(setup_signing::TARGET);
            #[cfg(feature = "signing")]
            self.set_up_signing(now, port, from, target, fields);
            #[cfg(not(feature = "signing"))]
            if self.addressed(now, port, target, Kind::Acts) == Some(Place::Node) {
                let text = Verbatim("no signing here: keep strangers off the link");
                self.say(now, Place::Node, Severity::Warning, Some(port), format_args!("{text}"));
            }
            return;
        }
        #[cfg(feature = "signing")]
        if !has_waited && !self.admits(now, port, &frame) {
            return;
        }
        #[cfg(not(feature = "signing"))]
        let _ = has_waited;
        match frame.id {
            HEARTBEAT_DATA::ID => {
                self.note_station(now, from.system);
                if self.autopilot_port == Some(port) {
                    let rest = !self.any_is_ordered();
                    let what = [heartbeat::TYPE, heartbeat::AUTOPILOT, heartbeat::BASE_MODE];
                    let event = self.vehicle.heartbeat(now, from, what.map(|at| fields.u8(at)).into(), rest);
                    self.vehicle_event(now, event);
                }
            }
            SERVO_OUTPUT_RAW_DATA::ID => {
                // Which output an engine follows is a setting.
                if self.autopilot_port == Some(port) && self.vehicle.is_autopilot(from) && !self.is_damaged()
                {
                    self.outputs(now, fields);
                }
            }
            RC_CHANNELS_OVERRIDE_DATA::ID => {
                let target = target(rc_channels_override::TARGET);
                let counts = self.may_command(from.system) && !self.is_damaged();
                if own == Some(target.system) && counts {
                    self.channels(now, target, fields);
                }
            }
            COMMAND_ACK_DATA::ID => {
                let target = target(command_ack::TARGET);
                let ours = own.is_some_and(|own| target.system == own || target.system == 0)
                    && (target.component == 0 || self.place(target.component) == Some(Place::Node));
                if self.autopilot_port == Some(port)
                    && self.vehicle.is_autopilot(from)
                    && fields.u16(command_ack::COMMAND) == CMD_SET_MESSAGE_INTERVAL
                    && ours
                {
                    self.request.answered(now, fields.u8(command_ack::RESULT) == 0);
                }
            }
            id @ (COMMAND_LONG_DATA::ID | COMMAND_INT_DATA::ID) => {
                let is_int = id == COMMAND_INT_DATA::ID;
                let params = core::array::from_fn(|i| {
                    let at = command::PARAMS + 4 * i;
                    if is_int && command::WHOLE.contains(&i) {
                        fields.u32(at).cast_signed() as f32
                    } else {
                        fields.f32(at)
                    }
                });
                let confirmation = if is_int { 0 } else { fields.u8(command::CONFIRMATION) };
                let number = fields.u16(command::COMMAND);
                self.command(now, port, from, target(command::TARGET), number, confirmation, params);
            }
            COMMAND_CANCEL_DATA::ID => {
                let number = fields.u16(command_cancel::COMMAND);
                self.cancel(now, port, from, target(command_cancel::TARGET), number);
            }
            PARAM_REQUEST_LIST_DATA::ID => {
                self.list_parameters(now, port, target(param_request_list::TARGET));
            }
            PARAM_REQUEST_READ_DATA::ID => {
                let index = fields.u16(param_request_read::INDEX).cast_signed();
                let name = fields.bytes::<16>(param_request_read::NAME);
                self.read_parameter(now, port, target(param_request_read::TARGET), &name, index);
            }
            PARAM_SET_DATA::ID => {
                let name = fields.bytes::<16>(param_set::NAME);
                let value = fields.f32(param_set::VALUE);
                self.set_parameter(now, port, from, target(param_set::TARGET), &name, value);
            }
            // Messages that we send ourselves.
            _ => {}
        }
    }

    fn note_station(&mut self, now: Instant, system: u8) {
        if !self.may_command(system) {
            return;
        }
        if let Some(known) = self.received.iter_mut().find(|(other, _)| *other == system) {
            known.1 = now;
        } else if self.received.push((system, now)).is_err()
            && let Some(oldest) = self.received.iter_mut().min_by_key(|(_, at)| *at)
        {
            *oldest = (system, now);
        }
    }

    fn vehicle_event(&mut self, now: Instant, event: Option<VehicleEvent>) {
        match event {
            Some(VehicleEvent::Learnt(id)) => {
                let when = if self.vehicle.id() == Some(id) { "" } else { " from the next start" };
                let text = format_args!("autopilot is system {}{}", Whole(id.into()), Verbatim(when));
                self.say(now, Place::Node, Severity::Info, None, text);
                self.store_learnt(id);
            }
            Some(VehicleEvent::TwoAutopilots(one, other)) => {
                // The node has no id while it learns: an observer of either system has to see the text.
                let observers = if self.vehicle.id().is_some() { 1 } else { 2 };
                for system in [one, other].into_iter().take(observers) {
                    self.speaks_as = Some(system);
                    let (one, other) = (Whole(one.into()), Whole(other.into()));
                    let text = format_args!("two autopilots, systems {one} and {other}: set MAV_SYSID");
                    self.say(now, Place::Node, Severity::Error, None, text);
                }
                self.speaks_as = None;
            }
            Some(VehicleEvent::Disarmed) => {
                self.engines.iter_mut().for_each(super::Engine::vehicle_disarmed);
            }
            None => {}
        }
    }

    fn outputs(&mut self, now: Instant, outputs: &Fields) {
        let of = usize::from(outputs.u8(servo_output_raw::PORT));
        let Some(clock) = self.clocks.get_mut(of) else { return };
        let disarmed = self.vehicle.arming() == Arming::Disarmed;
        if !clock.counts(now, outputs.u32(servo_output_raw::TIME_USEC), disarmed) {
            self.counters.demands_late = self.counters.demands_late.wrapping_add(1);
            return;
        }
        self.counters.demands = self.counters.demands.wrapping_add(1);
        if of == 0 {
            self.request.frame();
        }
        let first = 1 + 16 * of;
        for place in 0..self.engines.len() {
            let at = self.engines.get(place).and_then(|engine| {
                let of_outputs = engine.settings.demand_source() == DemandSource::ServoOutput;
                let output = usize::from(engine.settings.output).checked_sub(first)?;
                servo_output_raw::output(output).filter(|_| of_outputs)
            });
            if let Some(at) = at {
                self.demand(now, place, outputs.u16(at));
            }
        }
    }

    fn channels(&mut self, now: Instant, target: Address, channels: &Fields) {
        let Some(Place::Engine(place)) = self.place(target.component) else { return };
        let at = self.engines.get(place).and_then(|engine| {
            let of_channels = engine.settings.demand_source() == DemandSource::RcOverride;
            let channel = usize::from(engine.settings.output).checked_sub(1)?;
            rc_channels_override::channel(channel).filter(|_| of_channels)
        });
        if let Some(at) = at {
            self.demand(now, place, channels.u16(at));
        }
    }

    fn demand(&mut self, now: Instant, place: usize, pulse: u16) {
        let Some(engine) = self.engines.get_mut(place) else { return };
        let Some(demand) = throttle(&engine.settings, pulse) else {
            self.counters.demands_odd = self.counters.demands_odd.wrapping_add(1);
            return;
        };
        let refused = engine.take_demand(Self::situation(now, &self.vehicle, &self.received), demand);
        if let Some(why) = refused {
            self.say_not_started(now, place, why);
        }
    }
}
