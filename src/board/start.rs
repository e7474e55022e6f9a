//! The first instructions of every image: they put the core into its state after a reset, however the image was started.
//!
//! After a reset there is nothing to do. A bootloader, however, starts an application by a jump. ArduPilot's (AP_Bootloader,
//! `jump_to_app`) leaves interrupts masked (PRIMASK 1, BASEPRI 0x20), thread mode on the process stack (CONTROL 2), an
//! MPU region and, on an H7, the data cache on; older ones leave SysTick and other interrupts running. ST's loader
//! leaves VTOR at its own table after `dfu-util …:leave`. cortex-m-rt's start-up code undoes none of it. The
//! firmware itself also jumps here from a handler where a reset would not help (early.rs).
//!
//! The rules of `__pre_init`: RAM is not initialised, so no Rust; it uses no stack, since the one in use may be the
//! bootloader's. What the board needs before the RAM is initialised, pull-ups and the watchdog, is a list of writes
//! (first.rs). VTOR is set here, with interrupts off, and not by cortex-m-rt's feature `set-vtor`, which sets it
//! earlier: an interrupt that the bootloader left enabled would then reach our handler for unexpected interrupts.

// SAFETY: called by cortex-m-rt's `Reset`, once, before RAM is initialised. Touches r0 to r6 and r12, which `Reset` does
// not use across the call, no memory but registers of the core (Armv7-M, B3.2 to B3.5) and those of the board's steps, which
// nothing else uses yet, and returns by lr. Cleaning the data cache writes back what the bootloader wrote, as it intended.
core::arch::global_asm!(
    ".cfi_sections .debug_frame
     .section .text.__pre_init, \"ax\", %progbits
     .global __pre_init
     .type __pre_init, %function
     .thumb_func
     .cfi_startproc
     __pre_init:
     cpsid i",
    // An STM32H743 of revision Y may read wrong data from its AXI SRAM, the RAM of this firmware, when it reads twice at once
    // (ES0392 rev 8, 2.2.9). READ_ISS_OVERRIDE in AXI_TARG7_FN_MOD allows one read at a time, as in ST's SystemInit. On
    // revision V it changes nothing that this firmware needs, so it is set on every H743.
    ".if {axi_sram}
     ldr r0, =0x51008108
     movs r1, #1
     str r1, [r0]
     dsb
     .endif
     mrs r0, ipsr
     cbz r0, 9f",
    // In a handler. Each return ends one active exception and leads through `Reset` back to here, for the next interrupt in
    // IABR by number, or in thread mode when there is none. The floating-point state of the interrupted code is discarded
    // (FPCCR, LSPACT).
    "ldr r1, =_stack_start
     mov sp, r1
     ldr r1, =0xE000EF34
     ldr r2, [r1]
     bic r2, r2, #1
     str r2, [r1]
     ldr r1, =0xE000E300
     movs r2, #16
     5:
     ldr r3, [r1]
     subs r4, r0, r2
     cmp r4, #31
     bhi 6f
     movs r5, #1
     lsls r5, r4
     bics r3, r5
     6:
     cbnz r3, 7f
     adds r1, #4
     adds r2, #32
     cmp r2, #256
     blo 5b",
    // No interrupt. Is another exception active (ICSR, RETTOBASE)? SVCall to SysTick have bits (SHCSR). HardFault has none and
    // is the only one left: the crystal stopped while a fault was being handled, and the NMI preempted it.
    "ldr r1, =0xE000ED04
     ldr r3, [r1]
     movs r2, #0
     mvn r6, #6
     tst r3, #0x800
     bne 8f
     mvn r6, #14
     ldr r3, [r1, #0x20]
     and r3, r3, #0xD80
     subs r4, r0, #4
     cmp r4, #31
     bhi 6f
     movs r5, #1
     lsls r5, r4
     bics r3, r5
     6:
     movs r2, #4
     cbnz r3, 7f
     movs r2, #3
     b 8f
     7:
     rbit r3, r3
     clz r3, r3
     adds r2, r3
     mvn r6, #14
     8:
     ldr r1, =Reset
     bic r1, r1, #1
     orr r2, r2, #0x01000000
     push {{r1, r2}}
     sub sp, #24
     bx r6",
    "9:
     movs r0, #0
     msr control, r0
     isb
     ldr r1, =_stack_start
     msr msp, r1
     msr basepri, r0
     clrex",
    // The floating-point unit: off (CPACR), which `Reset` reverses, and its registers are saved by interrupts (FPCCR, ASPEN and
    // LSPEN). PX4's bootloader for an H7 leaves both bits clear (NuttX, `stm32_fpuconfig` in stm32h7/stm32_start.c). They may only
    // change while the unit is off and CONTROL.FPCA, cleared above, is 0.
    "ldr r1, =0xE000ED88
     str r0, [r1]
     dsb
     isb
     ldr r1, =0xE000EF34
     mov r2, #0xC0000000
     str r2, [r1]",
    // Not `msr faultmask`: while FAULTMASK is 1, only CPS changes it (Armv7-M, B5.2.1 and B5.2.3).
    "cpsie f",
    // SysTick off, then clear pending SysTick and PendSV (PENDSTCLR, PENDSVCLR).
    "ldr r1, =0xE000E010
     str r0, [r1]
     ldr r1, =0xE000ED00
     ldr r2, =0x0A000000
     str r2, [r1, #0x04]",
    // VTOR; AIRCR: priority groups as after a reset; SCR: no deep sleep.
    "ldr r2, =__vector_table
     str r2, [r1, #0x08]
     ldr r2, =0x05FA0000
     str r2, [r1, #0x0C]
     str r0, [r1, #0x10]",
    // SHPR1 to SHPR3; SHCSR: faults escalate to HardFault, which has a handler.
    "str r0, [r1, #0x18]
     str r0, [r1, #0x1C]
     str r0, [r1, #0x20]
     ldr r2, [r1, #0x24]
     bic r2, r2, #0x70000
     str r2, [r1, #0x24]",
    // NVIC_ICER and NVIC_ICPR, 240 interrupts.
    "ldr r2, =0xE000E180
     mvns r3, r0
     movs r4, #8
     1:
     str r3, [r2]
     str r3, [r2, #0x100]
     adds r2, #4
     subs r4, #1
     bne 1b",
    // NVIC_IPR: the drivers rely on the highest priority, the value after a reset.
    "ldr r2, =0xE000E400
     movs r4, #60
     1:
     str r0, [r2]
     adds r2, #4
     subs r4, #1
     bne 1b",
    // MPU_CTRL; then each region (MPU_TYPE, bits 8 to 15, says how many): MPU_RNR, MPU_RASR. Whole words: the MPU supports no
    // other access.
    "dmb
     str r0, [r1, #0x94]
     ldr r4, [r1, #0x90]
     ubfx r4, r4, #8, #8
     1:
     cbz r4, 2f
     subs r4, #1
     str r4, [r1, #0x98]
     str r0, [r1, #0xA0]
     b 1b
     2:
     dsb
     isb",
    // The data cache, if it is on (CCR bit 16; a Cortex-M4 has none): off, then cleaned and invalidated by set and
    // way (CSSELR 0, CCSIDR, DCCISW with sets from bit 5 and ways at the top). The labels are for the emulator, which cannot see
    // writes to registers of the core.
    "ldr r2, [r1, #0x14]
     tst r2, #0x10000
     beq 5f
     str r0, [r1, #0x84]
     dsb
     ldr r3, [r1, #0x80]
     bic r2, r2, #0x10000
     __pre_init_data_cache_off:
     str r2, [r1, #0x14]
     dsb
     ubfx r4, r3, #3, #10
     clz r12, r4
     ubfx r3, r3, #13, #15
     ldr r1, =0xE000EF74
     3:
     mov r5, r4
     4:
     lsl r2, r5, r12
     orr r2, r2, r3, lsl #5
     __pre_init_data_cache_line:
     str r2, [r1]
     subs r5, #1
     bpl 4b
     subs r3, #1
     bpl 3b
     5:
     dsb",
    // The instruction cache, if it is on (CCR bit 17): off, then invalidated (ICIALLU); the bootloader may just have written
    // other instructions to the flash.
    "ldr r1, =0xE000ED14
     ldr r2, [r1]
     tst r2, #0x20000
     beq 6f
     bic r2, r2, #0x20000
     __pre_init_instruction_cache_off:
     str r2, [r1]
     ldr r1, =0xE000EF50
     __pre_init_instruction_cache_empty:
     str r0, [r1]
     6:
     dsb
     isb",
    // The board's own first writes: pull-ups, watchdog (first.rs).
    "ldr r1, ={first}
     1:
     ldm r1!, {{r2, r3, r4}}
     cbz r2, 2f
     ldr r5, [r2]
     bics r5, r3
     orrs r5, r4
     str r5, [r2]
     b 1b
     2:
     dsb
     cpsie i
     __pre_init_end:
     bx lr
     .ltorg
     .cfi_endproc
     .size __pre_init, . - __pre_init",
    axi_sram = const cfg!(feature = "stm32h7") as u32,
    first = sym super::FIRST,
);
