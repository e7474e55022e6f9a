//! MAVLink on USB, with the feature `usb`: as a serial port, in thread mode, so that no engine's task waits for it.

use crate::board::{self, Oscillator};
use crate::mavlink::{Runner, USB_PORT};
use jetlink_usb::device::{self, LONGEST, Names, Place};
use static_cell::StaticCell;

const _: () = assert!(board::NAME.len() <= LONGEST, "the name of the board is too long for USB");

/// Serves the port. Where USB does not become ready, it stays off.
pub async fn serve(runner: &'static Runner, oscillator: Oscillator) {
    match board::usb::begin(oscillator).await {
        Ok(driver) => {
            defmt::info!("MAVLink: also on USB");
            let names = Names { product: board::NAME, serial_number: board::usb::serial_number() };
            static PLACE: StaticCell<Place<'static>> = StaticCell::new();
            device::serve(driver, PLACE.init_with(Place::default), names, runner, USB_PORT).await;
        }
        Err(why) => why.log(),
    }
}
