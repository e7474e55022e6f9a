//! Messages that come in, but commands and parameters.

use super::{Place, Service};
use crate::dialect::{MavMessage, RC_CHANNELS_OVERRIDE_DATA, SERVO_OUTPUT_RAW_DATA};
use crate::frame::{Address, Frame};
use crate::ids::{CMD_SET_MESSAGE_INTERVAL, Severity};
use crate::servo::throttle;
use crate::settings::DemandSource;
use crate::vehicle::VehicleEvent;
use embassy_time::Instant;
use jetlink::command::Order;

impl<const N: usize, const P: usize> Service<'_, N, P> {
    pub(super) fn handle(&mut self, now: Instant, port: usize, frame: Frame) {
        let from = frame.from;
        // Our own frames may come back.
        let own = self.system(now, port);
        if own == Some(from.system) && self.place(from.component).is_some() {
            return;
        }
        if let MavMessage::SETUP_SIGNING(setup) = &frame.message {
            self.set_up_signing(now, port, from, setup);
            return;
        }
        if !self.admits(now, port, &frame) {
            return;
        }
        match frame.message {
            MavMessage::HEARTBEAT(beat) => {
                self.note_station(now, from.system);
                if self.autopilot_port == Some(port) {
                    let rest = !self.engines.iter().any(|engine| {
                        matches!(
                            engine.telemetry().ordered.order,
                            Order::Run(_) | Order::Doubt(_) | Order::Pwm
                        )
                    });
                    let what = (beat.mavtype, beat.autopilot, beat.base_mode);
                    let event = self.vehicle.heartbeat(now, from, what, rest);
                    self.vehicle_event(now, event);
                }
            }
            MavMessage::SERVO_OUTPUT_RAW(outputs) => {
                if self.autopilot_port == Some(port) && self.vehicle.is_autopilot(from) {
                    self.outputs(now, &outputs);
                }
            }
            MavMessage::RC_CHANNELS_OVERRIDE(channels) => {
                if own == Some(channels.target_system) && self.may_command(from.system) {
                    self.channels(now, &channels);
                }
            }
            MavMessage::COMMAND_ACK(ack) => {
                let ours = own.is_some_and(|own| ack.target_system == own || ack.target_system == 0)
                    && (ack.target_component == 0 || self.place(ack.target_component) == Some(Place::Node));
                if self.autopilot_port == Some(port)
                    && self.vehicle.is_autopilot(from)
                    && ack.command == CMD_SET_MESSAGE_INTERVAL
                    && ours
                {
                    self.request.answered(now, ack.result == 0);
                }
            }
            MavMessage::COMMAND_LONG(command) => {
                let params = [
                    command.param1,
                    command.param2,
                    command.param3,
                    command.param4,
                    command.param5,
                    command.param6,
                    command.param7,
                ];
                let target = Address { system: command.target_system, component: command.target_component };
                self.command(now, port, from, target, command.command, command.confirmation, params);
            }
            MavMessage::COMMAND_INT(command) => {
                let params = [
                    command.param1,
                    command.param2,
                    command.param3,
                    command.param4,
                    command.x as f32,
                    command.y as f32,
                    command.z,
                ];
                let target = Address { system: command.target_system, component: command.target_component };
                self.command(now, port, from, target, command.command, 0, params);
            }
            MavMessage::COMMAND_CANCEL(cancel) => {
                let target = Address { system: cancel.target_system, component: cancel.target_component };
                self.cancel(now, port, from, target, cancel.command);
            }
            MavMessage::PARAM_REQUEST_LIST(request) => {
                let target = Address { system: request.target_system, component: request.target_component };
                self.list_parameters(now, port, target);
            }
            MavMessage::PARAM_REQUEST_READ(request) => {
                let target = Address { system: request.target_system, component: request.target_component };
                self.read_parameter(now, port, target, &request.param_id, request.param_index);
            }
            MavMessage::PARAM_SET(set) => {
                let target = Address { system: set.target_system, component: set.target_component };
                self.set_parameter(now, port, from, target, &set.param_id, set.param_value);
            }
            // Done above, and what we send ourselves.
            MavMessage::SETUP_SIGNING(_)
            | MavMessage::EFI_STATUS(_)
            | MavMessage::NAMED_VALUE_FLOAT(_)
            | MavMessage::PARAM_VALUE(_)
            | MavMessage::STATUSTEXT(_) => {}
        }
    }

    fn note_station(&mut self, now: Instant, system: u8) {
        if !self.may_command(system) {
            return;
        }
        if let Some(known) = self.heard.iter_mut().find(|(other, _)| *other == system) {
            known.1 = now;
        } else if self.heard.push((system, now)).is_err()
            && let Some(oldest) = self.heard.iter_mut().min_by_key(|(_, at)| *at)
        {
            *oldest = (system, now);
        }
    }

    fn vehicle_event(&mut self, now: Instant, event: Option<VehicleEvent>) {
        match event {
            Some(VehicleEvent::Learnt(id)) => {
                self.say(now, Place::Node, Severity::Info, None, format_args!("vehicle is system {id}"));
            }
            Some(VehicleEvent::TwoHeard(one, other)) => {
                // There is no id to send it with, but where one is set.
                self.say(
                    now,
                    Place::Node,
                    Severity::Error,
                    None,
                    format_args!("two autopilots, systems {one} and {other}: set MAV_SYSID"),
                );
            }
            Some(VehicleEvent::Disarmed) => {
                self.engines.iter_mut().for_each(super::Engine::vehicle_disarmed);
            }
            None => {}
        }
    }

    fn outputs(&mut self, now: Instant, outputs: &SERVO_OUTPUT_RAW_DATA) {
        let Some(clock) = self.clocks.get_mut(usize::from(outputs.port)) else { return };
        if !clock.counts(now, outputs.time_usec) {
            self.counters.demands_late = self.counters.demands_late.wrapping_add(1);
            return;
        }
        self.counters.demands = self.counters.demands.wrapping_add(1);
        if outputs.port == 0 {
            self.request.frame();
        }
        let pulses = [
            outputs.servo1_raw,
            outputs.servo2_raw,
            outputs.servo3_raw,
            outputs.servo4_raw,
            outputs.servo5_raw,
            outputs.servo6_raw,
            outputs.servo7_raw,
            outputs.servo8_raw,
            outputs.servo9_raw,
            outputs.servo10_raw,
            outputs.servo11_raw,
            outputs.servo12_raw,
            outputs.servo13_raw,
            outputs.servo14_raw,
            outputs.servo15_raw,
            outputs.servo16_raw,
        ];
        let first = 1 + 16 * usize::from(outputs.port);
        for place in 0..self.engines.len() {
            let pulse = self.engines.get(place).and_then(|engine| {
                let of_outputs = engine.settings.demand_source() == DemandSource::ServoOutput;
                let output = usize::from(engine.settings.output).checked_sub(first)?;
                pulses.get(output).copied().filter(|_| of_outputs)
            });
            if let Some(pulse) = pulse {
                self.demand(now, place, pulse);
            }
        }
    }

    fn channels(&mut self, now: Instant, channels: &RC_CHANNELS_OVERRIDE_DATA) {
        let Some(Place::Engine(place)) = self.place(channels.target_component) else { return };
        let pulses = [
            channels.chan1_raw,
            channels.chan2_raw,
            channels.chan3_raw,
            channels.chan4_raw,
            channels.chan5_raw,
            channels.chan6_raw,
            channels.chan7_raw,
            channels.chan8_raw,
            channels.chan9_raw,
            channels.chan10_raw,
            channels.chan11_raw,
            channels.chan12_raw,
            channels.chan13_raw,
            channels.chan14_raw,
            channels.chan15_raw,
            channels.chan16_raw,
            channels.chan17_raw,
            channels.chan18_raw,
        ];
        let pulse = self.engines.get(place).and_then(|engine| {
            let of_channels = engine.settings.demand_source() == DemandSource::RcOverride;
            pulses.get(usize::from(engine.settings.output).checked_sub(1)?).copied().filter(|_| of_channels)
        });
        if let Some(pulse) = pulse {
            self.demand(now, place, pulse);
        }
    }

    fn demand(&mut self, now: Instant, place: usize, pulse: u16) {
        let Some(engine) = self.engines.get_mut(place) else { return };
        let Some(demand) = throttle(&engine.settings, pulse) else {
            self.counters.demands_odd = self.counters.demands_odd.wrapping_add(1);
            return;
        };
        let refused = engine.take_demand(Self::situation(now, &self.vehicle, &self.heard), demand);
        if let Some(why) = refused {
            self.say_not_started(now, place, why);
        }
    }
}
