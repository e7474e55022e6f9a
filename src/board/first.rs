//! Writes to registers that come before everything else: `__pre_init` (start.rs) performs them, when the RAM is not yet
//! initialised. They are data, because no Rust may run there.

/// One write to a register.
#[derive(Clone, Copy)]
#[repr(C)] // start.rs reads the three words in this order
pub struct Step {
    register: *mut u32,
    clear: u32,
    set: u32,
}

// SAFETY: three words that never change. Whoever uses the address has to justify it.
unsafe impl Sync for Step {}

impl Step {
    /// The end of a list.
    pub const END: Self = Self { register: core::ptr::null_mut(), clear: 0, set: 0 };
}

#[cfg(feature = "stm32")]
impl Step {
    /// Clears some bits of the register at this offset of a peripheral, and sets others.
    pub const fn modify(peripheral: *mut (), offset: usize, clear: u32, set: u32) -> Self {
        Self { register: peripheral.wrapping_byte_add(offset).cast(), clear, set }
    }

    /// Sets bits.
    pub const fn set(peripheral: *mut (), offset: usize, bits: u32) -> Self {
        Self::modify(peripheral, offset, 0, bits)
    }

    /// Writes the whole register.
    pub const fn write(peripheral: *mut (), offset: usize, word: u32) -> Self {
        Self::modify(peripheral, offset, u32::MAX, word)
    }

    /// Reads the register and writes the same: what was written before is in effect when the next step begins.
    pub const fn read_back(peripheral: *mut (), offset: usize) -> Self {
        Self::modify(peripheral, offset, 0, 0)
    }

    /// Performs it.
    ///
    /// # Safety
    ///
    /// It has to be the step of a register that may be written now, and not [`Step::END`].
    #[cfg(feature = "ardupilot-bootloader")]
    pub unsafe fn perform(self) {
        // SAFETY: as the caller guarantees.
        unsafe { self.register.write_volatile(self.register.read_volatile() & !self.clear | self.set) }
    }
}

/// Length of the list of these steps.
pub const fn length(parts: &[&[Step]]) -> usize {
    let (mut steps, mut part) = (1, 0);
    while part < parts.len() {
        steps += parts[part].len();
        part += 1;
    }
    steps
}

/// The list of these steps, with its end.
pub const fn list<const N: usize>(parts: &[&[Step]]) -> [Step; N] {
    assert!(N == length(parts));
    let mut list = [Step::END; N];
    let (mut n, mut part) = (0, 0);
    while part < parts.len() {
        let mut step = 0;
        while step < parts[part].len() {
            list[n] = parts[part][step];
            n += 1;
            step += 1;
        }
        part += 1;
    }
    list
}
