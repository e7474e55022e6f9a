//! What describes a board: chip, clock, bootloader, ports, pins.

/// A board.
#[derive(Debug)]
pub struct Board {
    /// Name in commands: `board-<name>` is its feature, `cargo flash-<name>` flashes it.
    pub name: &'static str,
    /// Name for people, also in the log.
    pub title: &'static str,
    /// Other boards that the same image fits.
    pub also: &'static [&'static str],
    /// Chip.
    pub chip: &'static Chip,
    /// Clock at the chip's oscillator pins.
    pub clock: Clock,
    /// Bootloader that the board is sold with, or can be given.
    pub bootloader: Option<Bootloader>,
    /// ECU ports by number, from 0.
    pub ports: &'static [Port],
    /// Port of MAVLink, with no ECU on it.
    pub telemetry: Port,
    /// ECU port on which a receiver of radio control belongs. With a receiver there is no ECU on it.
    pub radio: u8,
    /// Socket for a receiver of radio control alone. The number of its port is the one behind those of `ports`.
    pub socket: Option<Socket>,
    /// Pins for fuel valves and for the power of starters and ignitions, by number, from 0.
    pub outputs: &'static [Output],
    /// Outputs that can be inputs for servo pulses instead.
    pub pulses: Option<PulseInputs>,
    /// Divider of the supply in front of an analogue input.
    pub supply: Option<Divider>,
    /// Memory for settings, if not the chip's own flash.
    pub fram: Option<Fram>,
    /// USB, for the feature of this name.
    pub usb: Usb,
    /// Status LED.
    pub led: Led,
    /// Pins that are driven from the start on.
    pub hold: &'static [Hold],
}

/// A chip, and how the firmware divides its memory.
#[derive(Debug, PartialEq, Eq)]
pub struct Chip {
    /// ST's name, without the package.
    pub name: &'static str,
    /// Feature of embassy-stm32 that selects it.
    pub feature: &'static str,
    /// Name in probe-rs.
    pub probe_rs: &'static str,
    /// Family, as far as the firmware makes a difference.
    pub family: Family,
    /// Flash, in one piece.
    pub flash: Region,
    /// Flash for code, from its beginning, in KiB. What comes after it is for settings, or not used.
    pub code_kib: u32,
    /// RAM for statics and stack.
    pub ram: Region,
    /// RAM that is retained over a reset, left alone by start-up and by bootloaders.
    pub retained: Region,
}

/// A family of chips, each with its own file in `src/board/`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// STM32F427.
    F4,
    /// STM32H743.
    H7,
}

impl Family {
    /// Whether its UARTs can invert what they receive, as SBUS needs it (RXINV; RM0433, 48.8.3; RM0090 has no such bit).
    pub const fn inverts(self) -> bool {
        matches!(self, Self::H7)
    }
}

/// A piece of memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First address.
    pub start: u32,
    /// Length in KiB.
    pub kib: u32,
}

/// STM32H743: 2 MiB of flash, 512 KiB of AXI SRAM in one piece.
///
/// Not used: ITCM 64K at 0x00000000, DTCM 128K at 0x20000000 (no DMA reaches them), SRAM1 to SRAM4. `retained` is where
/// bootloaders have nothing: ArduPilot's have their RAM in DTCM (0x20000000), formerly in SRAM1 (0x30000000); PX4's begins at
/// the start of the AXI SRAM, allocates from below and ends its heap at the end; so the last 7 KiB are also left free.
///
/// Its core has an LDO regulator and no SMPS, so there is no supply to choose; embassy-stm32 turns the LDO on
/// (`rcc/h.rs` of 0.6.0, `pwr_h7rm0433`).
pub(crate) const STM32H743VI: Chip = Chip {
    name: "STM32H743",
    feature: "stm32h743vi",
    probe_rs: "STM32H743VITx",
    family: Family::H7,
    flash: Region { start: 0x0800_0000, kib: 2048 },
    // Bank 1. Settings are in the last two sectors of bank 2: while that is written or erased, bank 1 is read on.
    code_kib: 1024,
    ram: Region { start: 0x2400_0000, kib: 504 },
    retained: Region { start: 0x2407_E000, kib: 2 },
};

/// The same in a package of 144 pins.
pub(crate) const STM32H743ZI: Chip =
    Chip { feature: "stm32h743zi", probe_rs: "STM32H743ZITx", ..STM32H743VI };

/// STM32F427: 2 MiB of flash, 192 KiB of SRAM (SRAM1 to SRAM3) in one piece.
///
/// Not used: CCM 64K at 0x10000000 (no DMA reaches it). `retained` is where bootloaders have nothing: ArduPilot's begins at the
/// start of the SRAM and needs a few KiB; PX4's has its stack at the top, of 128 KiB or of all; so the last 7 KiB are also
/// left free.
pub(crate) const STM32F427VI: Chip = Chip {
    name: "STM32F427",
    feature: "stm32f427vi",
    probe_rs: "STM32F427VITx",
    family: Family::F4,
    flash: Region { start: 0x0800_0000, kib: 2048 },
    code_kib: 2048,
    ram: Region { start: 0x2000_0000, kib: 184 },
    retained: Region { start: 0x2002_E000, kib: 2 },
};

/// What clocks a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// A crystal; its frequency in MHz.
    Crystal(u32),
    /// A clock that comes from elsewhere, in MHz; the chip's oscillator is bypassed.
    External(u32),
}

impl Clock {
    /// Frequency in MHz.
    pub const fn mhz(self) -> u32 {
        match self {
            Self::Crystal(mhz) | Self::External(mhz) => mhz,
        }
    }
}

/// A bootloader that an image can be linked behind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bootloader {
    /// Whose it is.
    pub of: &'static str,
    /// Number by which it knows the board (APJ_BOARD_ID).
    pub board_id: u16,
    /// Offset of the application in the flash, in KiB (FLASH_BOOTLOADER_LOAD_KB).
    pub load_kib: u32,
    /// End of the flash that is not the application's, in KiB (FLASH_RESERVE_END_KB).
    pub reserved_kib: u32,
}

/// A serial port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Port {
    /// ArduPilot's name, or what is printed on a board that ArduPilot does not count on.
    pub name: &'static str,
    /// UART.
    pub uart: &'static str,
    /// Receiving pin.
    pub rx: &'static str,
    /// Sending pin.
    pub tx: &'static str,
    /// Where to find it on the board.
    pub label: &'static str,
    /// What the bootloader does with TX.
    pub before: Before,
    /// Pin that keeps an inverter of the board out of the line.
    pub inverter: Option<Hold>,
}

/// What a port does while the bootloader runs. Without a bootloader it floats until the firmware sets its pull-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Before {
    /// TX is an input without a pull-up.
    Floats,
    /// TX is driven low: a break, for as long as the bootloader runs.
    DrivenLow,
    /// The port is the bootloader's: TX idles high, what comes in at RX is taken for an upload, and may be answered.
    Listens,
}

impl Port {
    /// A port without an inverter.
    pub(crate) const fn new(
        name: &'static str,
        uart: &'static str,
        [tx, rx]: [&'static str; 2],
        label: &'static str,
        before: Before,
    ) -> Self {
        Self { name, uart, rx, tx, label, before, inverter: None }
    }

    /// The same with an inverter, which this pin keeps out of the line.
    pub(crate) const fn inverter(self, hold: Hold) -> Self {
        Self { inverter: Some(hold), ..self }
    }
}

/// A socket for a receiver of radio control, whose UART only receives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Socket {
    /// Name that is printed on the board, or in its documents.
    pub name: &'static str,
    /// UART, which no other port has.
    pub uart: &'static str,
    /// Receiving pin.
    pub rx: &'static str,
    /// Sending pin of the UART, which is something else on this board: nothing may drive it.
    pub never_driven: LeftAlone,
    /// Pin that switches an inverter between the socket and the UART.
    pub inverter: &'static str,
    /// Level of that pin at which the inverter inverts. At the other one the line goes through as it is.
    pub inverts_at: Level,
    /// Name of its signal.
    pub signal: &'static str,
}

/// A pin that the firmware leaves alone: after a reset it is an input, and it stays one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LeftAlone {
    /// Pin.
    pub pin: &'static str,
    /// What it is on this board.
    pub why: &'static str,
}

/// A pin for the output of an engine. Without a bootloader it floats until the firmware drives it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Output {
    /// Pin.
    pub pin: &'static str,
    /// Where to find it on the board.
    pub label: &'static str,
    /// The bootloader drives it low, instead of leaving it an input. So what hangs on it has to be energised by the high level.
    pub low_before: bool,
}

impl Output {
    /// A pin that floats in the bootloader.
    pub(crate) const fn new(pin: &'static str, label: &'static str) -> Self {
        Self { pin, label, low_before: false }
    }

    /// A pin that the bootloader drives low.
    pub(crate) const fn low_before(pin: &'static str, label: &'static str) -> Self {
        Self { low_before: true, ..Self::new(pin, label) }
    }
}

/// An F-RAM on SPI. Which chip it is, the firmware reads from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fram {
    /// SPI.
    pub spi: &'static str,
    /// Clock.
    pub sck: &'static str,
    /// Data from the chip.
    pub miso: &'static str,
    /// Data to the chip.
    pub mosi: &'static str,
    /// Selects the chip while it is low.
    pub select: &'static str,
}

impl Fram {
    /// Its pins.
    pub fn pins(&self) -> [&'static str; 4] {
        [self.sck, self.miso, self.mosi, self.select]
    }
}

/// USB of the chip (OTG_FS). Whether there is power on the bus is not measured: some boards have no pin for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Usb {
    /// D-.
    pub minus: &'static str,
    /// D+.
    pub plus: &'static str,
    /// Where to find it on the board.
    pub label: &'static str,
}

impl Usb {
    /// At the only pins that both chips have for it.
    pub(crate) const fn at(label: &'static str) -> Self {
        Self { minus: "PA11", plus: "PA12", label }
    }
}

/// A pin that is driven from the start on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hold {
    /// Pin.
    pub pin: &'static str,
    /// Level.
    pub level: Level,
    /// The signal, and why.
    pub why: &'static str,
}

pub(crate) const fn low(pin: &'static str, why: &'static str) -> Hold {
    Hold { pin, level: Level::Low, why }
}

pub(crate) const fn high(pin: &'static str, why: &'static str) -> Hold {
    Hold { pin, level: Level::High, why }
}

/// RTS of the port of MAVLink. CTS is not used: the other end may send at any time.
pub(crate) const TELEMETRY_RTS: &str = "RTS of the port of MAVLink: ready";

/// A level of a pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "they say it")]
pub enum Level {
    Low,
    High,
}

/// Inputs for the servo pulses of a receiver, on the four channels of a timer with 16 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PulseInputs {
    /// Timer.
    pub timer: &'static str,
    /// Its interrupt for captures.
    pub interrupt: &'static str,
    /// Pins of its channels 1 to 4, which are channels 1 to 4 of the receiver. Each is an output of the board.
    pub pins: [&'static str; 4],
}

/// An analogue input of the ADC that measures the supply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Divider {
    /// Pin, an input of ADC1.
    pub pin: &'static str,
    /// Supply voltage to voltage at the pin, in tenths.
    pub tenths: u32,
    /// Which voltage it is.
    pub label: &'static str,
}

/// A status LED.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Led {
    /// Pin.
    pub pin: &'static str,
    /// Level at which it lights.
    pub lit: Level,
    /// Whether the pin only pulls low: the LED hangs on a supply that the pin should not be driven against.
    pub open_drain: bool,
    /// Colour and marking.
    pub label: &'static str,
}

impl Board {
    /// The flash of an image: all that is for code, or what the bootloader leaves of it.
    ///
    /// Nothing if there is no bootloader to link behind.
    pub fn flash(&self, behind_bootloader: bool) -> Option<Region> {
        let Region { start, kib } = self.chip.flash;
        let code_kib = self.chip.code_kib;
        if !behind_bootloader {
            return Some(Region { start, kib: code_kib });
        }
        let Bootloader { load_kib, reserved_kib, .. } = self.bootloader?;
        Some(Region { start: start + load_kib * 1024, kib: code_kib.min(kib - reserved_kib) - load_kib })
    }

    /// All pins that are driven from the start on, those of inverters among them.
    pub fn held(&self) -> impl Iterator<Item = Hold> {
        self.hold.iter().copied().chain(self.ports.iter().filter_map(|port| port.inverter))
    }
}
