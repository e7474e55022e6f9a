//! A guard below the stack: a region of RAM without access. Without it, a stack overflow would silently overwrite the
//! statics.

use cortex_m::peripheral::MPU;

/// Large, so that no stack frame skips it; a power of two, as the MPU requires.
const SIZE: u32 = 16 * 1024;

unsafe extern "C" {
    /// End of the statics (cortex-m-rt's linker script).
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

/// Arms the guard, above the statics. Call it once, at the start.
pub fn arm() {
    let base = base();
    // SAFETY: registers of the core, and nothing else uses the MPU. Region 0 blocks memory that only the stack may use, far
    // below its current depth; all other memory behaves as without an MPU (PRIVDEFENA). In the hard-fault handler the MPU
    // is disabled (HFNMIENA 0), so that the handler can still use the stack.
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
