//! A guard below the stack: a piece of RAM that nobody may touch. Without it a stack that grows too far goes through the
//! statics, silently.

use cortex_m::peripheral::MPU;

/// Large, so that no frame of a function steps over it; a power of two, as the MPU wants it.
const SIZE: u32 = 16 * 1024;

unsafe extern "C" {
    /// Where the statics end (cortex-m-rt's linker script).
    static _stack_end: u32;
}

/// The first address of the guard, above the statics.
fn base() -> u32 {
    (&raw const _stack_end as u32).next_multiple_of(SIZE)
}

/// The first address above the guard, which belongs to the stack.
pub fn end() -> u32 {
    base() + SIZE
}

/// Arms the guard, above the statics. To be called once, at the start.
pub fn arm() {
    let base = base();
    // SAFETY: registers of the core, and nothing else uses the MPU. Region 0 takes away memory that belongs to the stack
    // alone, far below where it is now; everything else stays as it is without an MPU (PRIVDEFENA). In the handler of
    // hard faults the MPU does not count (HFNMIENA 0), so that it can still use the stack.
    unsafe {
        let mpu = &*MPU::PTR;
        mpu.ctrl.write(0);
        mpu.rnr.write(0);
        mpu.rbar.write(base);
        mpu.rasr.write(1 << 28 | (SIZE.ilog2() - 1) << 1 | 1); // XN, no access
        mpu.ctrl.write(1 << 2 | 1);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}
