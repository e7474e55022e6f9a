//! Pins for fuel valves and for the power of starters and ignitions. A pin is an input, or whatever a bootloader left, until it is driven
//! for the first time. Nothing else changes it: a panic or a fault leaves it as it is, and the reset that follows makes it float.

use super::table::OUTPUT_PINS;
use embassy_stm32::pac::gpio::vals::{Moder, Odr, Ot, Pupdr};

/// Drives an output of the board. Not from two priorities at once: the mode of a port's pins is one register.
pub fn drive_output(number: u8, high: bool) {
    let Some(&(gpio, pin)) = OUTPUT_PINS.get(usize::from(number)) else { return };
    if (gpio.odr().read().odr(pin) == Odr::HIGH) != high {
        // One write that leaves the port's other pins alone.
        gpio.bsrr().write(|w| if high { w.set_bs(pin, true) } else { w.set_br(pin, true) });
    }
    // A bootloader may have made it an output already, an open drain perhaps.
    if gpio.otyper().read().ot(pin) != Ot::PUSH_PULL {
        gpio.otyper().modify(|w| w.set_ot(pin, Ot::PUSH_PULL));
    }
    if gpio.moder().read().moder(pin) != Moder::OUTPUT {
        gpio.pupdr().modify(|w| w.set_pupdr(pin, Pupdr::FLOATING));
        // Last: from here on the level is driven.
        gpio.moder().modify(|w| w.set_moder(pin, Moder::OUTPUT));
    }
}
