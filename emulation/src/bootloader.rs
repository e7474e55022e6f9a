//! A stand-in for an ArduPilot bootloader, or PX4's: instructions that leave the part in the same state and jump in the same
//! way as the real one. Written from Tools/AP_Bootloader (`bl_protocol.cpp`, `AP_Bootloader.cpp`), from ChibiOS as that uses
//! it, and from the reference manuals; assembled here, so that a test can choose the state left behind.
//!
//! PX4's: PX4-Autopilot, `platforms/nuttx/src/bootloader/common/bl.c` (`jump_to_app`) and `stm/stm32_common/main.c`
//! (`clock_deinit`, `board_deinit`, `arch_do_jump`), `boards/px4/fmu-v6c/nuttx-config/bootloader/defconfig`; for an F427
//! PX4-Bootloader, `bl.c` and `main_f4.c`.
//!
//! Not modelled: actions of the real bootloader before its jump (USB, its own LED), and its wait of 5 s for an
//! upload, unless [`Bootloader::decides`] is set.

use crate::board::{Board, Part};

/// How the bootloader jumps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Jump {
    /// Up to 2019, and PX4's: loads the main stack pointer only. The process stack pointer stays in the bootloader's own RAM.
    Old,
    /// Loads `sp` and the main stack pointer.
    New,
}

/// The state that a bootloader leaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leftover {
    /// `port_disable()`: PRIMASK is 1.
    Primask,
    /// `chSysLock()`: BASEPRI is 0x20.
    Basepri,
    /// FAULTMASK is 1. ArduPilot's does not leave it; a start must not depend on that.
    Faultmask,
    /// ChibiOS runs its threads on the process stack: CONTROL is 2.
    ProcessStack,
    /// SysTick counts, interrupts, and runs out a few microseconds after the jump.
    SysTick,
    /// PendSV is pending. Only with PRIMASK set; otherwise the bootloader's own handler would have taken it.
    PendSv,
    /// Two peripheral interrupts are enabled and pending, one of them forever. Only with PRIMASK set.
    Interrupts,
    /// Every interrupt has the lowest priority: the start has to set them all to be the same as after a reset.
    Priorities,
    /// A timer's interrupt is enabled, and the timer runs out a few milliseconds after the jump.
    LiveTimer,
    /// Region 6 of the MPU is on, over the beginning of the application's RAM, and allows no access.
    Mpu,
    /// The data cache is on, as ChibiOS turns it on (H743).
    DataCache,
    /// The PLL clocks the core, with ArduPilot's dividers; kernel clocks come from other sources than after a reset.
    Pll,
    /// The independent watchdog runs, with 1.25 ms left.
    Watchdog,
    /// The independent watchdog runs, and its largest prescaler has just been written.
    WatchdogCrossing,
    /// VTOR is still the bootloader's: ArduPilot's does not leave it so, but ST's own loader does after a "leave".
    Vtor,
    /// PX4's: the core is back on the internal oscillator, the PLLs and the crystal are off, the bus dividers and the flash's
    /// wait states are not restored (`clock_deinit`).
    HalfResetClocks,
    /// PX4's: AHB1ENR is 0, or its reset value; on an F427 no GPIO port has a clock (`board_deinit`).
    BusClocksOff,
    /// PX4's: the floating-point unit is on and in use, and interrupts do not save its registers: NuttX saves them itself
    /// and clears ASPEN and LSPEN (`stm32_fpuconfig` in NuttX's stm32h7/stm32_start.c).
    Fpu,
    /// The floating-point unit was used and is off again, with its state still to be saved (CONTROL.FPCA is 1). No known
    /// bootloader leaves this; a start must not depend on that.
    FpuOff,
    /// PX4's: the instruction cache is on (H743).
    InstructionCache,
    /// PX4's: the interrupt of USB is enabled.
    UsbInterrupt,
}

/// A bootloader.
#[derive(Clone, Debug)]
pub struct Bootloader {
    /// Its jump.
    pub jump: Jump,
    /// The state that it leaves.
    pub leaves: Vec<Leftover>,
    /// It checks the cause of the reset and the first backup register like the real one: after a watchdog reset or
    /// with `RTC_BOOT_FAST` it jumps at once, otherwise after 5 s. Before that, its start-up resets the backup
    /// domain if the RTC's clock is not the wanted one.
    pub decides: bool,
}

impl Default for Bootloader {
    /// Jumps at once and leaves nothing.
    fn default() -> Self {
        Self { jump: Jump::New, leaves: Vec::new(), decides: false }
    }
}

impl Leftover {
    /// The state left by the present bootloader, and more: everything that is compatible.
    pub const ALL: [Self; 14] = [
        Self::Primask,
        Self::Basepri,
        Self::Faultmask,
        Self::ProcessStack,
        Self::SysTick,
        Self::PendSv,
        Self::Interrupts,
        Self::Priorities,
        Self::LiveTimer,
        Self::Mpu,
        Self::DataCache,
        Self::Pll,
        Self::Watchdog,
        Self::FpuOff,
    ];

    /// The state left by PX4's. NuttX sets all priorities to 0x80; the lowest are a harder test. Whether its threads run
    /// on the process stack depends on its version.
    pub const PX4: [Self; 7] = [
        Self::HalfResetClocks,
        Self::BusClocksOff,
        Self::Fpu,
        Self::InstructionCache,
        Self::UsbInterrupt,
        Self::Priorities,
        Self::ProcessStack,
    ];
}

/// How long the bootloader waits for an upload (HAL_BOOTLOADER_TIMEOUT), in ms.
pub const WAIT_MS: u64 = 5000;

/// `RTC_BOOT_FAST`: start the application at once (hwdef/common/stm32_util.h).
pub const BOOT_FAST: u32 = 0xB007_0002;

impl Bootloader {
    /// Its vector table and instructions, to be placed at `at`, for an application whose vector table is at `table`
    /// and begins with these two words.
    pub(crate) fn assemble(&self, board: &Board, at: u64, table: u64, jump: [u32; 2]) -> Vec<u8> {
        let mut code = Code::default();
        let registers = Registers::of(board.part);
        if self.decides {
            decide(&mut code, board, &registers);
        }
        let leaves = |leftover| self.leaves.contains(&leftover);
        if leaves(Leftover::Pll) || leaves(Leftover::HalfResetClocks) {
            match board.part {
                Part::H743 => pll_h743(&mut code, board),
                Part::F427 => pll_f427(&mut code, board),
            }
        }
        if leaves(Leftover::HalfResetClocks) {
            let (config, pll, pll_reset) = match board.part {
                Part::H743 => (0x10, 0x2C, 0x01FF_0000),
                Part::F427 => (0x08, 0x04, 0x2400_3010),
            };
            code.write(registers.rcc + config, 0);
            code.wait_clear(registers.rcc + config, 0b11 << if board.part == Part::H743 { 3 } else { 2 });
            // HSEON, CSSON, PLLON; on an H743 PLL2ON and PLL3ON.
            let plls = if board.part == Part::H743 { 0b1_0101 << 24 } else { 1 << 24 };
            code.modify(registers.rcc, 0, 1 << 16 | 1 << 19 | plls);
            code.write(registers.rcc + pll, pll_reset);
            code.modify(registers.rcc, 0, 1 << 18);
        }
        if leaves(Leftover::BusClocksOff) {
            match board.part {
                Part::H743 => code.write(registers.rcc + 0xD8, 0),
                Part::F427 => code.write(registers.rcc + 0x30, 0x0010_0000),
            }
        }
        if leaves(Leftover::Fpu) {
            code.modify(CPACR, 0xF << 20, 0);
            code.push(&DSB);
            code.push(&ISB);
            code.push(&[0xEE00, 0x0A10]); // vmov s0, r0
            code.modify(FPCCR, 0, 0b11 << 30);
        }
        if leaves(Leftover::FpuOff) {
            code.modify(CPACR, 0xF << 20, 0);
            code.push(&DSB);
            code.push(&ISB);
            code.push(&[0xEE00, 0x0A10]); // vmov s0, r0
            code.modify(CPACR, 0, 0xF << 20);
            code.push(&DSB);
            code.push(&ISB);
        }
        if leaves(Leftover::InstructionCache) && board.part == Part::H743 {
            code.modify(CCR, 1 << 17, 0);
        }
        if leaves(Leftover::UsbInterrupt) {
            let interrupt = match board.part {
                Part::H743 => 101,
                Part::F427 => 67,
            };
            code.write(NVIC_ISER + 4 * (interrupt / 32), 1 << (interrupt % 32));
        }
        if leaves(Leftover::Watchdog) {
            // 10 counts of 4 periods of its 32 kHz: the start has to take it over in time.
            let watchdog = board.watchdog as u32;
            code.write(watchdog, 0xCCCC);
            code.write(watchdog, 0x5555);
            code.write(watchdog + 4, 0);
            code.write(watchdog + 8, 9);
            code.wait_clear(watchdog + 12, 0b11);
            code.write(watchdog, 0xAAAA);
        }
        if leaves(Leftover::WatchdogCrossing) {
            let watchdog = board.watchdog as u32;
            code.write(watchdog, 0xCCCC);
            code.write(watchdog, 0x5555);
            code.write(watchdog + 4, 6);
        }
        if leaves(Leftover::Mpu) {
            // Region 6, 32 KiB, no access; the rest as without an MPU.
            code.write(MPU_RNR, 6);
            code.write(MPU_RBAR, board.ram.start as u32);
            code.write(MPU_RASR, 14 << 1 | 1);
            code.write(MPU_CTRL, 0b101);
        }
        if leaves(Leftover::DataCache) && board.part == Part::H743 {
            code.modify(CCR, 1 << 16 | 1 << 17, 0); // DC and IC
        }
        if leaves(Leftover::Primask) {
            code.push(&[0xB672]); // cpsid i
        }
        if leaves(Leftover::Faultmask) {
            code.push(&[0xB671]); // cpsid f
        }
        if leaves(Leftover::Interrupts) {
            // TIM2 and an EXTI line: enabled and pending.
            code.write(NVIC_ISER, 1 << 28 | 1 << 6);
            code.write(NVIC_ISPR, 1 << 28 | 1 << 6);
            // One far up in the table: UART8.
            code.write(NVIC_ISER + 8, 1 << 19);
            code.write(NVIC_ISPR + 8, 1 << 19);
        }
        if leaves(Leftover::Priorities) {
            // 240 of them, four to a word.
            code.set(0, NVIC_IPR);
            code.set(1, 0xF0F0_F0F0);
            code.set(2, 60);
            let top = code.0.len();
            code.push(&[0xC002, 0x3A01]); // stmia r0!, {r1}; subs r2, #1
            code.branch_back_unless_equal(top);
        }
        if leaves(Leftover::LiveTimer) {
            // TIM2, ChibiOS's system timer: 2 ms at the slowest, over and over.
            code.modify(registers.apb1_enable, 1, 0);
            code.write(TIM2 + 0x2C, 30_000);
            code.write(TIM2 + 0x0C, 1);
            code.write(NVIC_ISER, 1 << 28);
            code.write(TIM2, 1);
        }
        if leaves(Leftover::PendSv) {
            code.write(ICSR, 1 << 28);
        }
        if leaves(Leftover::Basepri) {
            code.set(0, 0x20);
            code.msr(0, BASEPRI);
        }
        if leaves(Leftover::ProcessStack) {
            code.set(0, registers.own_stack);
            code.msr(0, PSP);
            code.set(0, 2);
            code.msr(0, CONTROL);
            code.push(&ISB);
        }
        if leaves(Leftover::SysTick) {
            // Runs out within the start of the application.
            code.write(SYST_RVR, 200);
            code.write(SYST_CVR, 0);
            code.write(SYST_CSR, 0b111);
        }
        code.write(VTOR, if leaves(Leftover::Vtor) { at } else { table } as u32);
        code.set(0, jump[0]);
        code.set(1, jump[1]);
        if self.jump == Jump::New {
            code.push(&[0x4685]); // mov sp, r0
        }
        code.msr(0, MSP);
        code.push(&[0x4708]); // bx r1

        // The bootloader's own table: its stack, its start, and for everything else a handler that loops.
        let end = entry(at) + 2 * code.0.len() as u32;
        let mut words = vec![registers.own_stack, entry(at)];
        words.resize(TABLE_WORDS as usize, end);
        code.push(&[0xE7FE]); // b .
        let mut bytes: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
        bytes.extend(code.0.into_iter().flat_map(u16::to_le_bytes));
        bytes
    }
}

/// Start address of a bootloader at `at`, from its table.
pub(crate) const fn entry(at: u64) -> u32 {
    (at as u32 + 4 * TABLE_WORDS) | 1
}

/// What differs from part to part.
struct Registers {
    rcc: u32,
    /// RCC_APB1ENR, or RCC_APB1LENR.
    apb1_enable: u32,
    /// The register with the causes of the reset, and the watchdog's flag in it.
    reset_cause: u32,
    watchdog_flag: u32,
    /// RCC_BDCR, its bit that resets the backup domain, and the wanted RTCSEL.
    backup_control: u32,
    backup_reset: u32,
    wanted: u32,
    /// PWR_CR or PWR_CR1.
    power: u32,
    /// In the bootloader's RAM: DTCM on the H743, the first SRAM on the F427.
    own_stack: u32,
}

impl Registers {
    fn of(part: Part) -> Self {
        match part {
            Part::H743 => Self {
                rcc: 0x5802_4400,
                apb1_enable: 0x5802_44E8,
                reset_cause: 0x5802_44D0,
                watchdog_flag: 1 << 26,
                backup_control: 0x5802_4470,
                backup_reset: 1 << 16,
                wanted: 0 << 8, // STM32_RTCSEL_NOCLK in stm32h7_mcuconf.h
                power: 0x5802_4800,
                own_stack: 0x2000_0400,
            },
            Part::F427 => Self {
                rcc: 0x4002_3800,
                apb1_enable: 0x4002_3840,
                reset_cause: 0x4002_3874,
                watchdog_flag: 1 << 29,
                backup_control: 0x4002_3870,
                backup_reset: 1 << 16,
                wanted: 2 << 8, // STM32_RTCSEL_LSI in stm32f47_mcuconf.h
                power: 0x4000_7000,
                own_stack: 0x2000_0400,
            },
        }
    }
}

/// ChibiOS's start-up and the bootloader's `main`: the backup domain, then the jump at once or after 5 s.
fn decide(code: &mut Code, board: &Board, registers: &Registers) {
    if board.part == Part::F427 {
        code.modify(registers.apb1_enable, 1 << 28, 0); // PWREN
    } else {
        code.modify(registers.rcc + 0xF4, 1 << 16, 0); // RTCAPBEN
    }
    code.modify(registers.power, 1 << 8, 0); // DBP
    // hal_lld_backup_domain_init(): with another clock than its own, it resets the domain.
    code.load(registers.backup_control);
    code.set(2, 0x300);
    code.push(&[0x4011]); // ands r1, r2
    code.set(3, registers.wanted);
    code.push(&[0x4299]); // cmp r1, r3
    let reset = |code: &mut Code| {
        code.write(registers.backup_control, registers.backup_reset);
        code.write(registers.backup_control, 0);
    };
    code.unless_equal(reset);
    if registers.wanted != 0 {
        code.modify(registers.backup_control, registers.wanted | 1 << 15, 0);
    }
    // r4: the word. set_fast_reboot(RTC_BOOT_OFF) clears it; set_rtc_backup() first turns RTCEN on.
    code.load(board.backup as u32);
    code.push(&[0x460C]); // mov r4, r1
    code.modify(registers.backup_control, 1 << 15, 0);
    code.write(board.backup as u32, 0);
    // r5: 0 where it jumps at once.
    code.set(5, 1);
    code.set(3, BOOT_FAST);
    code.push(&[0x42A3]); // cmp r3, r4
    code.if_equal(|code| code.set(5, 0));
    code.load(registers.reset_cause);
    code.set(2, registers.watchdog_flag);
    code.push(&[0x4011]); // ands r1, r2
    code.push(&[0x4291]); // cmp r1, r2
    code.if_equal(|code| code.set(5, 0));
    // Waits asleep, timed by SysTick. The emulator counts it at the core's rate, whatever the clock tree: 20 ms fit its 24 bits.
    code.push(&[0x2D00]); // cmp r5, #0
    code.unless_equal(|code| {
        code.push(&[0xB672]); // cpsid i: SysTick wakes, and has no handler
        code.write(SYST_RVR, (board.core_hz / 50) as u32 - 1);
        code.write(SYST_CVR, 0);
        code.write(SYST_CSR, 0b111);
        code.set(5, WAIT_MS as u32 / 20);
        let top = code.0.len();
        code.push(&[0xBF30]); // wfi
        code.write(ICSR, 1 << 25);
        code.push(&[0x3D01]); // subs r5, #1
        code.branch_back_unless_equal(top);
        code.write(SYST_CSR, 0);
        code.push(&[0xB662]); // cpsie i
    });
}

/// ArduPilot's clocks (stm32h7_mcuconf.h): 400 MHz from the crystal.
fn pll_h743(code: &mut Code, board: &Board) {
    const RCC: u32 = 0x5802_4400;
    const PWR: u32 = 0x5802_4800;
    code.write(PWR + 0x18, 0b11 << 14); // D3CR: scale 1
    code.wait(PWR + 0x18, 1 << 13);
    code.modify(RCC, 1 << 16, 0); // HSEON
    code.wait(RCC, 1 << 17);
    let divm = (board.crystal / 8_000_000) as u32;
    code.write(RCC + 0x28, 32 << 20 | 32 << 12 | divm << 4 | 2); // PLLCKSELR: HSE
    code.write(RCC + 0x2C, 0x01FF_0000 | 3 << 2); // PLLCFGR: 8 to 16 MHz, wide
    code.write(RCC + 0x30, 1 << 24 | 7 << 16 | 1 << 9 | 99); // PLL1DIVR: 800 MHz, 400, 100, 400
    code.modify(RCC, 1 << 24, 0); // PLL1ON
    code.wait(RCC, 1 << 25);
    code.write(0x5200_2000, 2 << 4 | 2); // FLASH_ACR
    code.write(RCC + 0x18, 4 << 4 | 8);
    code.write(RCC + 0x1C, 4 << 8 | 4 << 4);
    code.write(RCC + 0x20, 4 << 4);
    code.modify(RCC + 0x10, 1 << 15 | 3, 0); // CFGR: TIMPRE, PLL1
    code.wait(RCC + 0x10, 3 << 3);
    code.write(RCC + 0x54, 2 << 3 | 2); // D2CCIP2R: the UARTs from PLL3, which does not run
}

/// ArduPilot's clocks (stm32f47_mcuconf.h): 168 MHz from the crystal.
fn pll_f427(code: &mut Code, board: &Board) {
    const RCC: u32 = 0x4002_3800;
    code.modify(RCC + 0x40, 1 << 28, 0); // PWREN
    code.modify(RCC, 1 << 16, 0); // HSEON
    code.wait(RCC, 1 << 17);
    let m = (board.crystal / 1_000_000) as u32;
    code.write(RCC + 0x04, 7 << 24 | 1 << 22 | 336 << 6 | m);
    code.modify(RCC, 1 << 24, 0); // PLLON
    code.wait(RCC, 1 << 25);
    code.write(0x4002_3C00, 0x700 | 5); // FLASH_ACR
    code.write(RCC + 0x08, 4 << 13 | 5 << 10 | 2); // CFGR: APB2 by 2, APB1 by 4, PLL
    code.wait(RCC + 0x08, 2 << 2);
}

const TABLE_WORDS: u32 = 16 + 150;

const SYST_CSR: u32 = 0xE000_E010;
const SYST_RVR: u32 = 0xE000_E014;
const SYST_CVR: u32 = 0xE000_E018;
const NVIC_ISER: u32 = 0xE000_E100;
const NVIC_ISPR: u32 = 0xE000_E200;
const NVIC_IPR: u32 = 0xE000_E400;
const ICSR: u32 = 0xE000_ED04;
const VTOR: u32 = 0xE000_ED08;
const CCR: u32 = 0xE000_ED14;
const CPACR: u32 = 0xE000_ED88;
const FPCCR: u32 = 0xE000_EF34;
const MPU_CTRL: u32 = 0xE000_ED94;
const MPU_RNR: u32 = 0xE000_ED98;
const MPU_RBAR: u32 = 0xE000_ED9C;
const MPU_RASR: u32 = 0xE000_EDA0;
const TIM2: u32 = 0x4000_0000;

/// Numbers of special registers (Armv7-M, B5.1.1).
const MSP: u16 = 8;
const PSP: u16 = 9;
const BASEPRI: u16 = 17;
const CONTROL: u16 = 20;

const ISB: [u16; 2] = [0xF3BF, 0x8F6F];
const DSB: [u16; 2] = [0xF3BF, 0x8F4F];

/// Thumb instructions (Armv7-M, A7.7), as halfwords.
#[derive(Default)]
struct Code(Vec<u16>);

impl Code {
    fn push(&mut self, halfwords: &[u16]) {
        self.0.extend_from_slice(halfwords);
    }

    /// movw and movt.
    fn set(&mut self, register: u16, value: u32) {
        for (opcode, half) in [(0xF240, value as u16), (0xF2C0, (value >> 16) as u16)] {
            let (imm4, i, imm3, imm8) = (half >> 12, half >> 11 & 1, half >> 8 & 7, half & 0xFF);
            self.push(&[opcode | i << 10 | imm4, imm3 << 12 | register << 8 | imm8]);
        }
    }

    fn msr(&mut self, register: u16, special: u16) {
        self.push(&[0xF380 | register, 0x8800 | special]);
    }

    /// r1 = *address, with the address in r0.
    fn load(&mut self, address: u32) {
        self.set(0, address);
        self.push(&[0x6801]); // ldr r1, [r0]
    }

    fn write(&mut self, address: u32, value: u32) {
        self.set(0, address);
        self.set(1, value);
        self.push(&[0x6001]); // str r1, [r0]
    }

    fn modify(&mut self, address: u32, set: u32, clear: u32) {
        self.load(address);
        self.set(2, set);
        self.push(&[0x4311]); // orrs r1, r2
        if clear != 0 {
            self.set(2, clear);
            self.push(&[0x4391]); // bics r1, r2
        }
        self.push(&[0x6001]);
    }

    /// Loops until all of these bits are set.
    fn wait(&mut self, address: u32, bits: u32) {
        self.set(0, address);
        self.set(2, bits);
        let top = self.0.len();
        self.push(&[0x6801, 0x4011, 0x4291]); // ldr r1, [r0]; ands r1, r2; cmp r1, r2
        self.branch_back_unless_equal(top);
    }

    /// Loops until none of these bits is set.
    fn wait_clear(&mut self, address: u32, bits: u32) {
        self.set(0, address);
        self.set(2, bits);
        let top = self.0.len();
        self.push(&[0x6801, 0x4011]); // ldr r1, [r0]; ands r1, r2
        self.branch_back_unless_equal(top);
    }

    fn branch_back_unless_equal(&mut self, top: usize) {
        let back = self.0.len() + 2 - top;
        assert!(back <= 0x80);
        self.push(&[0xD100 | (0x100 - back as u16)]);
    }

    /// Skips `body` by this conditional branch, depending on the flags.
    fn skip(&mut self, opcode: u16, body: impl FnOnce(&mut Self)) {
        let at = self.0.len();
        self.push(&[0]);
        body(self);
        let over = self.0.len() - at - 2;
        assert!(over < 0x80, "{over}");
        self.0[at] = opcode | over as u16;
    }

    fn if_equal(&mut self, body: impl FnOnce(&mut Self)) {
        self.skip(0xD100, body); // bne
    }

    fn unless_equal(&mut self, body: impl FnOnce(&mut Self)) {
        self.skip(0xD000, body); // beq
    }
}
