//! The compiler's routines for memory that is aligned, as branches to those for any memory: `compiler_builtins` has each of them in full, for
//! speed, and a copy here is of some hundred bytes at most.

use core::arch::naked_asm;

/// Functions that only branch. They replace those of `compiler_builtins`, which are weak.
macro_rules! branches {
    ($($name:ident: $($instruction:literal)+;)+) => {
        $(
            // SAFETY: the name and its arguments, in registers, are those of the run-time ABI for Arm, and the routine that it branches to takes
            // memory of any alignment and returns to the caller.
            #[unsafe(naked)]
            #[unsafe(no_mangle)]
            unsafe extern "C" fn $name() {
                naked_asm!($($instruction),+)
            }
        )+
    };
}

branches! {
    __aeabi_memcpy4: "b __aeabi_memcpy";
    __aeabi_memcpy8: "b __aeabi_memcpy";
    __aeabi_memset4: "b __aeabi_memset";
    __aeabi_memset8: "b __aeabi_memset";
    // Destination and length are in r0 and r1, and the byte of a memset in r2.
    __aeabi_memclr: "movs r2, #0" "b __aeabi_memset";
    __aeabi_memclr4: "movs r2, #0" "b __aeabi_memset";
    __aeabi_memclr8: "movs r2, #0" "b __aeabi_memset";
}
