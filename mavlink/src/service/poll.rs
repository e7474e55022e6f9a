//! What drives the service: the bytes of each port, and the time.

use super::{Place, Service};
use crate::attached::Attached;
use embassy_time::{Duration, Instant};

/// Time between two checks of the engines.
const TICK: Duration = Duration::from_millis(50);
const HEARTBEAT_EVERY: Duration = Duration::from_secs(1);

impl<const N: usize, const P: usize, A: Attached> Service<'_, N, P, A> {
    /// Takes bytes of a port, counted from 0. Commands are carried out at once; call [`Service::poll`] and
    /// [`Service::transmit`] afterwards.
    pub fn receive(&mut self, now: Instant, port: usize, mut bytes: &[u8]) {
        loop {
            let open = self.ports.get_mut(port).filter(|port| port.is_open());
            let Some(decoder) = open.map(|port| &mut port.decoder) else { return };
            let (taken, frame) = decoder.receive(self.signing.key(), bytes);
            bytes = bytes.get(taken..).unwrap_or_default();
            match frame {
                Some(frame) => {
                    self.handle(now, port, frame, false);
                    #[cfg(feature = "signing")]
                    self.cover.carried_out();
                }
                None => return,
            }
        }
    }

    /// Does what is due, and returns when to call it again.
    pub fn poll(&mut self, now: Instant) -> Instant {
        if now >= self.next_tick {
            self.next_tick = now + TICK;
            self.tick(now);
        }
        #[cfg(feature = "signing")]
        while let Some((port, frame)) = self.take_waiting(now) {
            self.handle(now, port, frame, true);
            self.cover.carried_out();
        }
        let lists = self.send_lists(now);
        lists.into_iter().chain([self.next_tick]).min().unwrap_or(self.next_tick)
    }

    fn tick(&mut self, now: Instant) {
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
        #[cfg(feature = "signing")]
        self.cover_from_time_to_time(now);
        self.store_learnt_at_rest();
        self.report_lost_texts(now);
        self.report_attached(now);
        if now >= self.next_heartbeat {
            self.next_heartbeat = now + HEARTBEAT_EVERY;
            self.report_settings(now);
            self.send_signing(now);
            for port in 0..self.ports.len() {
                self.send_heartbeat(now, port, Place::Node);
                (0..self.engines.len())
                    .for_each(|engine| self.send_heartbeat(now, port, Place::Engine(engine)));
            }
        }
        self.request_rate(now);
        self.send_all_telemetry(now);
    }
}
