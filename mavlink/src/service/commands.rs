//! Commands: each gets its final answer at once, and a text with the reason if it is refused.

use super::{Place, Service};
use crate::attached::{Attached, sealed::Streams};
use crate::dialect::COMMAND_ACK_DATA;
use crate::frame::Address;
use crate::ids::{
    Ack, CMD_DO_ENGINE_CONTROL, CMD_DO_FLIGHTTERMINATION, CMD_PREFLIGHT_REBOOT_SHUTDOWN, CMD_REQUEST_MESSAGE,
    CMD_SET_MESSAGE_INTERVAL, CMD_USER_1, MESSAGE_EFI_STATUS, MESSAGE_HEARTBEAT, MESSAGE_NAMED_VALUE_FLOAT,
    MESSAGE_RC_CHANNELS, MESSAGE_RELAY_STATUS, Severity,
};
use crate::kind::Kind;
use crate::number::whole;
use crate::port::{Class, Interval};
use crate::refusal::Refusal;
use crate::services::{self, NodeService};
use embassy_time::{Duration, Instant};

/// Shortest interval of a message that may be requested.
const SHORTEST: Duration = Duration::from_millis(50);
/// Bit of `DO_ENGINE_CONTROL`: a start while disarmed is allowed.
const WHILE_DISARMED: i32 = 1;

/// The answer to a command, with the reason of a refusal if a text has to report it.
type Answer = Result<Ack, (Ack, Option<Refusal>)>;

fn refuse(why: Refusal) -> Answer {
    Err((why.ack(), Some(why)))
}

fn done(result: Result<(), Refusal>) -> Answer {
    result.map_or_else(refuse, |()| Ok(Ack::Accepted))
}

impl<const N: usize, const P: usize, A: Attached> Service<'_, N, P, A> {
    #[allow(clippy::too_many_arguments, reason = "the fields of two messages")]
    pub(super) fn command(
        &mut self,
        now: Instant,
        port: usize,
        from: Address,
        target: Address,
        command: u16,
        confirmation: u8,
        params: [f32; 7],
    ) {
        let [first, ..] = params;
        let kind = Kind::of_command(command, first);
        // Component 0 addresses all components: none obeys it.
        let Some(place) = self.addressed(now, port, target, kind) else { return };
        self.counters.commands = self.counters.commands.wrapping_add(1);
        let own = self.system(now, port);
        let answer = match self.check(port, from.system, kind) {
            Ok(()) => self.obey(now, port, from, place, command, confirmation, params),
            Err(why) => refuse(why),
        };
        #[cfg(feature = "signing")]
        if kind == Kind::Stops && answer.is_ok_and(|ack| ack != Ack::Unsupported) {
            self.take_back(place);
        }
        self.answer(own, now, port, from, place, command, answer);
    }

    /// Answers with the system id that the node had when the command arrived: after a stop it may have none.
    #[allow(clippy::too_many_arguments, reason = "the fields of two messages")]
    fn answer(
        &mut self,
        own: Option<u8>,
        now: Instant,
        port: usize,
        to: Address,
        place: Place,
        command: u16,
        answer: Answer,
    ) {
        self.speaks_as = own;
        let (result, why) = match answer {
            Ok(ack) => (ack, None),
            Err((ack, why)) => (ack, why),
        };
        if !matches!(result, Ack::Accepted | Ack::InProgress | Ack::Cancelled) {
            self.counters.commands_refused = self.counters.commands_refused.wrapping_add(1);
        }
        self.acknowledge(now, port, to, place, command, result);
        if let Some(why) = why {
            self.say(now, place, Severity::Warning, Some(port), format_args!("refused: {why}"));
        }
        self.speaks_as = None;
    }

    fn acknowledge(
        &mut self,
        now: Instant,
        port: usize,
        to: Address,
        place: Place,
        command: u16,
        result: Ack,
    ) {
        let ack = COMMAND_ACK_DATA {
            command,
            result: result as u8,
            // Unknown while it is in progress.
            progress: if result == Ack::InProgress { u8::MAX } else { 0 },
            result_param2: 0,
            target_system: to.system,
            target_component: to.component,
        };
        self.send(now, port, place, Class::Answer, &ack);
    }

    /// Answers whoever waits for the end of a start. `again`: also if it has not ended.
    pub(super) fn report_progress(&mut self, now: Instant, place: usize, again: bool) {
        let Some(engine) = self.engines.get_mut(place) else { return };
        let Some((port, to)) = engine.progress else { return };
        let ended = engine.start_ended();
        if ended.is_some() {
            engine.progress = None;
        }
        if ended.is_some() || again {
            let result = ended.unwrap_or(Ack::InProgress);
            self.acknowledge(now, port.into(), to, Place::Engine(place), CMD_DO_ENGINE_CONTROL, result);
        }
    }

    #[allow(clippy::too_many_arguments, reason = "the fields of two messages")]
    fn obey(
        &mut self,
        now: Instant,
        port: usize,
        from: Address,
        place: Place,
        command: u16,
        confirmation: u8,
        params: [f32; 7],
    ) -> Answer {
        let [first, second, third, fourth, ..] = params;
        match (command, place) {
            (CMD_DO_ENGINE_CONTROL, Place::Engine(engine)) => {
                let numbers = (whole(first), whole(second), whole(third), whole(fourth));
                match numbers {
                    // A stop acts whatever its unused fields are. NaN means "unused" in MAVLink.
                    (Some(0), ..) => self.stop_engine(now, engine),
                    (Some(1), Some(0 | 1), Some(0), Some(bits @ (0 | WHILE_DISARMED))) => {
                        self.start_engine(now, port, from, engine, confirmation, bits == WHILE_DISARMED)
                    }
                    _ => refuse(Refusal::Malformed(
                        "DO_ENGINE_CONTROL: param1 0 or 1; start: param2 and 4 0 or 1, param3 0",
                    )),
                }
            }
            (CMD_DO_FLIGHTTERMINATION, _) => match whole(first) {
                Some(1) => self.emergency_stop(now, place),
                _ => refuse(Refusal::Malformed("DO_FLIGHTTERMINATION: param1 has to be 1")),
            },
            (CMD_USER_1, _) => self.user_service(now, port, place, params),
            (CMD_PREFLIGHT_REBOOT_SHUTDOWN, Place::Node) => match whole(first) {
                Some(1) if self.any_turns() => refuse(Refusal::Turns),
                Some(1) => {
                    self.reboot = true;
                    Ok(Ack::Accepted)
                }
                _ => refuse(Refusal::Malformed("PREFLIGHT_REBOOT_SHUTDOWN: only a reboot, param1 = 1")),
            },
            (CMD_SET_MESSAGE_INTERVAL | CMD_REQUEST_MESSAGE, Place::Engine(engine))
                if first == MESSAGE_EFI_STATUS as f32 && !self.sends_efi(port, engine) =>
            {
                refuse(Refusal::Malformed("the autopilot mixes up engines: see MAV_EFI_ENGINE"))
            }
            (CMD_SET_MESSAGE_INTERVAL, _) => self.set_interval(now, port, place, first, second),
            (CMD_REQUEST_MESSAGE, _) => self.request_message(now, port, place, first),
            _ => Ok(Ack::Unsupported),
        }
    }

    fn start_engine(
        &mut self,
        now: Instant,
        port: usize,
        from: Address,
        engine: usize,
        confirmation: u8,
        while_disarmed: bool,
    ) -> Answer {
        if self.is_damaged() {
            return refuse(Refusal::Damaged);
        }
        if self.reboot {
            return refuse(Refusal::Restarts);
        }
        // It would be judged by a setting that may not stay.
        if self.is_being_set(engine) {
            return refuse(Refusal::StoreBusy);
        }
        let Some(engine) = self.engines.get_mut(engine) else { return Ok(Ack::Unsupported) };
        let situation = Self::situation(now, &self.vehicle, &self.received);
        let answer = engine.start(situation, from, confirmation, while_disarmed);
        if answer.is_ok() && self.settings.progress {
            engine.progress = u8::try_from(port).ok().map(|port| (port, from));
        }
        match answer {
            Ok(()) | Err((Ack::Accepted, None)) if engine.progress.is_some() => Ok(Ack::InProgress),
            answer => answer.map(|()| Ack::Accepted),
        }
    }

    fn stop_engine(&mut self, now: Instant, engine: usize) -> Answer {
        self.engines.get_mut(engine).map_or(Ok(Ack::Unsupported), |engine| done(engine.stop(now)))
    }

    /// Stops one engine, or all of them if the node is addressed.
    fn emergency_stop(&mut self, now: Instant, place: Place) -> Answer {
        for (i, engine) in self.engines.iter_mut().enumerate() {
            if place == Place::Node || place == Place::Engine(i) {
                engine.emergency_stop(now);
            }
        }
        Ok(Ack::Accepted)
    }

    fn user_service(&mut self, now: Instant, port: usize, place: Place, params: [f32; 7]) -> Answer {
        let service = match services::find(params) {
            Ok(service) => service,
            Err(what) => return refuse(Refusal::Malformed(what)),
        };
        match (service, place) {
            (NodeService::EmergencyStop, _) => self.emergency_stop(now, place),
            #[cfg(feature = "signing")]
            (NodeService::ConfirmSettings, Place::Node) => {
                done(self.confirm_settings(now, self.is_usb(port)))
            }
            // If they are damaged, it has been refused: nobody is known to be at the board.
            #[cfg(not(feature = "signing"))]
            (NodeService::ConfirmSettings, _) => Ok(Ack::Unsupported),
            #[cfg(feature = "signing")]
            (NodeService::ConfirmSettings, _) => {
                refuse(Refusal::Malformed("address the component of the node"))
            }
            (NodeService::CalibrateStick(begin), Place::Engine(engine)) => {
                done(self.calibrate_stick(now, port, engine, begin))
            }
            (service, Place::Engine(engine)) => {
                let Some(engine) = self.engines.get_mut(engine) else { return Ok(Ack::Unsupported) };
                done(match service {
                    NodeService::EmergencyStop
                    | NodeService::ConfirmSettings
                    | NodeService::CalibrateStick(_) => Ok(()),
                    NodeService::Release => engine.release(),
                    NodeService::Stop => engine.stop(now),
                    NodeService::Ecu(service) => engine.service(service),
                })
            }
            (_, Place::Node) => refuse(Refusal::Malformed("address the component of an engine")),
        }
    }

    /// `COMMAND_CANCEL` of a start is a stop.
    pub(super) fn cancel(&mut self, now: Instant, port: usize, from: Address, target: Address, command: u16) {
        let kind = Kind::of_cancel(command);
        let Some(place) = self.addressed(now, port, target, kind) else { return };
        self.counters.commands = self.counters.commands.wrapping_add(1);
        let own = self.system(now, port);
        let answer = match (self.check(port, from.system, kind), command, place) {
            (Err(why), ..) => refuse(why),
            (Ok(()), CMD_DO_ENGINE_CONTROL, Place::Engine(engine)) => {
                self.stop_engine(now, engine).map(|ack| match ack {
                    Ack::Accepted => Ack::Cancelled,
                    ack => ack,
                })
            }
            _ => Ok(Ack::Unsupported),
        };
        #[cfg(feature = "signing")]
        if answer.is_ok_and(|ack| ack == Ack::Cancelled) {
            self.take_back(place);
        }
        self.answer(own, now, port, from, place, command, answer);
    }

    /// A stop cancels what waits for its engine; a stop of all engines, all that waits.
    #[cfg(feature = "signing")]
    fn take_back(&mut self, place: Place) {
        let component = place.engine().map(|_| self.component(place));
        self.cover.stopped(component);
    }

    fn set_interval(
        &mut self,
        now: Instant,
        port: usize,
        place: Place,
        message: f32,
        interval: f32,
    ) -> Answer {
        let message = whole(message).and_then(|message| u32::try_from(message).ok());
        let schedule = message.and_then(|message| match place {
            Place::Node if message == MESSAGE_RELAY_STATUS && !self.attached.has_outputs() => None,
            Place::Node => self.streams.get_mut(port)?.schedule(message),
            Place::Engine(engine) => {
                let streams = self.ports.get_mut(port)?.streams.get_mut(engine)?;
                match message {
                    MESSAGE_EFI_STATUS => Some(&mut streams.efi),
                    MESSAGE_NAMED_VALUE_FLOAT => Some(&mut streams.values),
                    _ => None,
                }
            }
        });
        let Some(schedule) = schedule else { return Ok(Ack::Unsupported) };
        let interval = match whole(interval) {
            Some(-1) => Interval::Off,
            Some(0) => Interval::Default,
            Some(us @ 1..) if u64::from(us.unsigned_abs()) >= SHORTEST.as_micros() => {
                Interval::Every(Duration::from_micros(us.unsigned_abs().into()))
            }
            _ => return refuse(Refusal::Malformed("SET_MESSAGE_INTERVAL: 50 000 us or longer, 0 or -1")),
        };
        schedule.set(now, interval);
        Ok(Ack::Accepted)
    }

    fn request_message(&mut self, now: Instant, port: usize, place: Place, message: f32) -> Answer {
        let message = whole(message).and_then(|message| u32::try_from(message).ok());
        match (message, place) {
            (Some(MESSAGE_HEARTBEAT), _) => self.send_heartbeat(now, port, place),
            (Some(MESSAGE_EFI_STATUS), Place::Engine(engine)) => {
                self.send_efi(now, port, engine, Class::Requested);
            }
            (Some(MESSAGE_NAMED_VALUE_FLOAT), Place::Engine(engine)) => {
                self.send_values(now, port, engine, true, Class::Requested);
            }
            (Some(MESSAGE_RELAY_STATUS), Place::Node) if self.attached.has_outputs() => {
                self.send_relays(now, port, Class::Requested);
            }
            (Some(MESSAGE_RC_CHANNELS), Place::Node) if self.attached.channels(now).is_some() => {
                self.send_channels(now, port, Class::Requested);
            }
            _ => return Ok(Ack::Unsupported),
        }
        Ok(Ack::Accepted)
    }
}
