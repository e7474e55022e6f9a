//! The emulated part and the devices on its UARTs: rigless's bench of the part, our ECUs in place of its own far
//! ends, and the watchdog that one part lacks.

use core::ops::Range;
use rigless::chip::Placed;
use rigless::chip::uart::{Errors, TcpPeer};
use rigless::device::{Device, ErasedDevice, Level, ResetCause};
use rigless::machine::stm32f427_bench::Stm32f427Bench;
use rigless::machine::stm32h743_bench::Stm32h743Bench;
use rigless::machine::{self, Crystal, Target};
use rigless::mcu::{Mcu, Operate};
use rigless::snapshot::Store;
use rigless::soc::stm32f427::peripherals as f427;
use rigless::soc::stm32h743::peripherals as h743;
use rigless::soc::{Bus, Width};
use rigless::time::VirtualNanos;

use crate::board::{Board, Divider, Inputs, Part, Socket, Timer, Uart};
use crate::cpu;
use crate::fram::Fram;
use crate::pulses::PulseReceiver;
use crate::quirks::{DeadRegulator, Iwdg, Rtc, Stuck};
use crate::wire::Wire;

/// rigless's index of SPI2 on either part.
const SPI2: usize = 1;

const GPIO_PORTS: [&str; 5] = ["GPIOA", "GPIOB", "GPIOC", "GPIOD", "GPIOE"];

#[derive(Debug)]
enum Bench {
    H743(Box<Stm32h743Bench>),
    F427(Box<Stm32f427Bench>),
}

macro_rules! each {
    ($part:expr, $bench:ident => $e:expr) => {
        match $part {
            Bench::H743($bench) => $e,
            Bench::F427($bench) => $e,
        }
    };
}

/// Where rigless has a part's UARTs.
fn place_of(part: Part, uart: Uart) -> usize {
    use Uart::*;
    let order = match part {
        Part::H743 => [Usart1, Usart2, Usart3, Uart4, Uart5, Usart6, Uart7, Uart8],
        Part::F427 => [Usart1, Usart2, Usart3, Usart6, Uart7, Uart8, Uart4, Uart5],
    };
    order.iter().position(|&each| each == uart).expect("all are there")
}

/// The part.
#[derive(Debug)]
pub struct Chip {
    part: Bench,
    iwdg: Iwdg,
    /// Index of a watchdog without a model in the part's description.
    iwdg_slot: Option<usize>,
    rtc: Rtc,
    /// The same of the real-time clock.
    rtc_slot: Option<usize>,
    /// Index of the power controller, which a defective one may replace.
    pwr_slot: usize,
    dead_regulator: DeadRegulator,
    /// Hardware that never becomes ready until the next reset.
    pub stuck: Option<Stuck>,
}

impl Mcu for Chip {
    fn bus(&self) -> &Bus {
        each!(&self.part, b => b.mcu.bus())
    }

    fn bus_mut(&mut self) -> &mut Bus {
        each!(&mut self.part, b => b.mcu.bus_mut())
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        each!(&mut self.part, b => b.mcu.reset(at, cause));
        Device::reset(&mut self.iwdg);
        self.stuck = None;
    }

    fn poll(&mut self, now: VirtualNanos) {
        each!(&mut self.part, b => b.mcu.poll(now));
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        if Some(slot) == self.iwdg_slot {
            return (each!(&mut self.part, b => b.mcu.bus_mut()), Some(&mut self.iwdg));
        }
        if Some(slot) == self.rtc_slot {
            return (each!(&mut self.part, b => b.mcu.bus_mut()), Some(&mut self.rtc));
        }
        if slot == self.pwr_slot && self.stuck == Some(Stuck::VoltageScale) {
            return (each!(&mut self.part, b => b.mcu.bus_mut()), Some(&mut self.dead_regulator));
        }
        each!(&mut self.part, b => b.mcu.split(slot))
    }
}

/// The board as the emulator runs it.
#[derive(Debug)]
pub struct Rig {
    /// The part.
    pub chip: Chip,
    kind: Part,
    /// Flash and RAM.
    memory: Vec<Range<u64>>,
    instructions_per_second: u64,
    /// UARTs with an ECU.
    wired: Vec<Uart>,
    /// A receiver with servo pulses, and its wires.
    pulses: Option<(PulseReceiver, Inputs)>,
    /// Inverter of the board's socket for a receiver.
    inverter: Option<Inverter>,
    /// The crystal does not start.
    pub dead_crystal: bool,
}

/// An inverter between a receiver's line and its UART. The emulated UART carries words whatever the level, so a line of the wrong level, or
/// one whose inverter nobody drives, is a line that is cut.
#[derive(Clone, Copy, Debug)]
struct Inverter {
    uart: Uart,
    /// MODER and ODR of the port of its pin, the number of the pin, and the level that makes a good line of this one.
    registers: [u64; 2],
    number: u8,
    good: bool,
    /// Whether bytes go through, as far as known.
    passes: Option<bool>,
}

impl Store for Rig {} // no snapshots

impl Rig {
    /// The board with nothing on its ports.
    pub fn new(board: &Board, instructions_per_second: u64) -> Self {
        let mut part = match board.part {
            Part::H743 => Bench::H743(Box::new(Stm32h743Bench::new().expect("the bench of the H743"))),
            Part::F427 => Bench::F427(Box::new(Stm32f427Bench::new().expect("the bench of the F427"))),
        };
        each!(&mut part, b => {
            b.hse = Crystal(board.crystal);
            b.mcu.rcc.attach_crystals(board.crystal, 0);
        });
        let pwr_slot = each!(&part, b => b.mcu.bus().slot("PWR")).expect("the part has a power controller");
        let mut chip = Chip {
            part,
            iwdg: Iwdg::default(),
            iwdg_slot: None,
            rtc: Rtc,
            rtc_slot: None,
            pwr_slot,
            dead_regulator: DeadRegulator,
            stuck: None,
        };
        Device::reset(&mut chip.iwdg);
        if board.part == Part::H743 {
            chip.iwdg_slot = Some(chip.bus().slot("IWDG").expect("the H743's description has a watchdog"));
            chip.rtc_slot = Some(chip.bus().slot("RTC").expect("the H743's description has a clock"));
        }
        let memory = vec![board.flash.clone(), board.ram.start..board.above.end];
        Self {
            chip,
            kind: board.part,
            memory,
            instructions_per_second,
            wired: Vec::new(),
            pulses: None,
            inverter: None,
            dead_crystal: false,
        }
    }

    /// Connects a wire to a UART.
    pub fn attach(&mut self, uart: Uart, mut wire: Wire) {
        if self.kind == Part::H743 {
            wire.requested_early();
        }
        let at = place_of(self.kind, uart);
        each!(&mut self.chip.part, b => b.mcu.usart[at].attach(wire));
        self.wired.push(uart);
    }

    /// Connects an F-RAM to SPI2, in place of what rigless's bench has there; `None`: nothing.
    pub fn attach_fram(&mut self, (port, number): (char, u8), fram: Option<Fram>) {
        let port = GPIO_PORTS[usize::from(port as u8 - b'A')];
        macro_rules! attach {
            ($spi:expr, $chip:ident) => {{
                let pin = $chip::gpio::Pin::new(number).expect("a port has sixteen pins");
                // The bench's own device cannot be removed, but does not use the bus while it is silent.
                let _ = $spi.silence(0, true);
                if let Some(fram) = fram {
                    $spi.attach_selected(fram, $chip::spi::Select { port, pin, active: Level::Low });
                }
            }};
        }
        match &mut self.chip.part {
            Bench::H743(bench) => attach!(bench.mcu.spi[SPI2], h743),
            Bench::F427(bench) => attach!(bench.mcu.spi[SPI2], f427),
        }
    }

    /// The F-RAM, if there is one.
    pub fn fram(&mut self) -> Option<&mut Fram> {
        each!(&mut self.chip.part, b => b.mcu.spi[SPI2].chip_mut::<Fram>(1))
    }

    /// Connects a TCP port to a UART.
    pub fn attach_tcp(&mut self, uart: Uart, peer: TcpPeer) {
        let at = place_of(self.kind, uart);
        each!(&mut self.chip.part, b => b.mcu.usart[at].attach(peer));
    }

    /// The wire on a UART, if there is one.
    pub fn wire(&mut self, uart: Uart) -> Option<&mut Wire> {
        let at = place_of(self.kind, uart);
        each!(&mut self.chip.part, b => b.mcu.usart[at].chip_mut::<Wire>())
    }

    /// All wires.
    fn wires(&mut self, mut act: impl FnMut(&mut Wire)) {
        for i in 0..self.wired.len() {
            if let Some(wire) = self.wire(self.wired[i]) {
                act(wire);
            }
        }
    }

    /// Puts the inverter of a socket between its UART and a line, which may be inverted.
    pub fn attach_inverter(&mut self, socket: Socket, inverted: bool, gpio: u64) {
        let (port, number) = socket.inverter;
        let port = gpio + 0x400 * u64::from(port as u8 - b'A');
        self.inverter = Some(Inverter {
            uart: socket.port.uart,
            registers: [port, port + 0x14],
            number,
            good: inverted == socket.inverts_at,
            passes: None,
        });
    }

    /// Looks at the pin of the inverter.
    fn look_at_inverter(&mut self, now: u64) {
        let Some(Inverter { uart, registers, number, good, passes }) = self.inverter else { return };
        let [mode, data] = registers.map(|register| self.peek(now, register).expect("a GPIO port"));
        let is_output = mode >> (2 * number) & 0b11 == 0b01;
        let pass = is_output && (data >> number & 1 == 1) == good;
        if passes != Some(pass) {
            self.cut(uart, !pass);
            self.inverter = Some(Inverter { uart, registers, number, good, passes: Some(pass) });
        }
    }

    /// Connects a receiver with servo pulses.
    pub fn attach_pulses(&mut self, receiver: PulseReceiver, inputs: Inputs) {
        self.pulses = Some((receiver, inputs));
    }

    /// The receiver with servo pulses, if there is one.
    pub fn pulses(&mut self) -> Option<&mut PulseReceiver> {
        self.pulses.as_mut().map(|(receiver, _)| receiver)
    }

    /// Puts a level on an input for servo pulses: on its pin, and on the timer's channel if the pin is assigned to it.
    fn drive_input(&mut self, at: VirtualNanos, inputs: Inputs, channel: usize, high: bool) {
        let (pin, level) = (inputs.pins[channel], Level::from(high));
        let port = usize::from(pin.port as u8 - b'A');
        macro_rules! drive_pin {
            ($mcu:expr, $chip:ident) => {{
                let number = $chip::gpio::Pin::new(pin.number).expect("a port has sixteen pins");
                $mcu.drive_port(at, port, |gpio, registers, context| {
                    gpio.drive(number, Some(level), registers, context);
                    $chip::gpio::Gpio::function(number, registers) == Some(pin.function)
                })
            }};
        }
        let number = channel as u8 + 1;
        match &mut self.chip.part {
            Bench::H743(bench) => {
                assert_eq!(inputs.timer, Timer::Tim4, "the timer of the boards with an H743");
                if drive_pin!(bench.mcu, h743) {
                    let channel = h743::tim::Channel::new(number).expect("a channel");
                    // The third of its timers. rigless gives either the timer or its bus.
                    let fresh = h743::tim::Tim::new(h743::tim::TIMERS[2]);
                    let mut timer = std::mem::replace(&mut bench.mcu.tim[2], fresh);
                    let slot = bench.mcu.bus().slot("TIM4").expect("the part has a TIM4");
                    let (registers, mut context) = bench.mcu.bus_mut().drive(at, slot);
                    timer.drive_input(channel, level, registers, &mut context);
                    bench.mcu.tim[2] = timer;
                }
            }
            Bench::F427(bench) => {
                assert_eq!(inputs.timer, Timer::Tim1, "the timer of the boards with an F427");
                if drive_pin!(bench.mcu, f427) {
                    let channel = f427::tim::Channel::new(number).expect("a channel");
                    bench.mcu.drive_advanced_timer(at, 0, |timer, registers, context| {
                        timer.drive_input(channel, level, registers, context);
                    });
                }
            }
        }
    }

    /// The supply voltage in front of the board's divider, in mV.
    pub fn battery(&mut self, divider: Divider, millivolts: u32) {
        let Bench::H743(bench) = &mut self.chip.part else { panic!("only an H743 has a divider") };
        let channel = h743::adc::Channel::new(divider.channel).expect("a channel");
        bench.mcu.adc[0].set_input(channel, millivolts / divider.ratio);
    }

    /// Advances the far ends to `now`.
    pub fn reached(&mut self, now: u64) {
        self.look_at_inverter(now);
        self.wires(|wire| wire.reached(now));
        if let Some((receiver, inputs)) = &mut self.pulses {
            let (levels, inputs) = (receiver.advance(now), *inputs);
            for (channel, high) in levels {
                self.drive_input(VirtualNanos(now), inputs, channel, high);
            }
        }
    }

    /// Time of the next action of a far end, after `now`.
    pub fn next(&mut self, now: u64) -> Option<u64> {
        let mut next = None;
        self.wires(|wire| next = next.into_iter().chain(wire.next(now)).min());
        next.into_iter().chain(self.pulses.as_ref().map(|(receiver, _)| receiver.next())).min()
    }

    /// Cuts or mends a wire.
    pub fn cut(&mut self, uart: Uart, cut: bool) {
        let at = place_of(self.kind, uart);
        let _ = each!(&mut self.chip.part, b => b.mcu.usart[at].silence(cut));
        if let Some(wire) = self.wire(uart) {
            wire.cut = cut;
        }
    }

    /// Noise on the bytes to the board.
    pub fn errors(&mut self, uart: Uart) -> &mut Errors {
        let at = place_of(self.kind, uart);
        each!(&mut self.chip.part, b => b.mcu.usart[at].errors_mut())
    }

    /// Loss or change of single bytes on their way to the board.
    pub fn place(&mut self, uart: Uart) -> Option<&mut dyn Placed> {
        let at = place_of(self.kind, uart);
        each!(&mut self.chip.part, b => b.mcu.usart[at].place_mut())
    }

    /// Makes the watchdog's registers take the longest allowed time to cross over: on an H743 six LSI periods, times
    /// the prescaler; on an F427 rigless's five periods, of the slowest LSI.
    pub fn slow_watchdog(&mut self) {
        self.chip.iwdg.slow = true;
        if let Bench::F427(bench) = &mut self.chip.part {
            bench.mcu.rcc.calibrate_lsi(17_000);
        }
    }

    /// Sets the flag of a brown-out reset (BORRSTF in RCC_RSR; RCC_CSR of an F427): rigless has no such reset.
    pub fn flag_brown_out(&mut self) {
        self.flag_reset(21, 25);
    }

    /// Sets the flag of a power-on (PORRSTF).
    pub fn flag_power_on(&mut self) {
        self.flag_reset(23, 27);
    }

    /// Sets the flag with this number of an H743, or of an F427.
    fn flag_reset(&mut self, h743: u32, f427: u32) {
        use rigless::soc::{stm32f427, stm32h743};
        let slot = self.chip.bus().slot("RCC").expect("the part has a clock controller");
        let registers = self.chip.bus_mut().slot_mut(slot).registers_mut();
        match self.kind {
            Part::H743 => {
                let register = stm32h743::generated::rcc::Register::Rsr;
                registers.set(register, registers.get(register) | 1 << h743);
            }
            Part::F427 => {
                let register = stm32f427::generated::rcc::Register::Csr;
                registers.set(register, registers.get(register) | 1 << f427);
            }
        }
    }

    /// The voltage of the supply, in mV.
    pub fn supply(&mut self, millivolts: u32) {
        each!(&mut self.chip.part, b => b.mcu.set_supply(millivolts));
    }

    /// A register, without the effects of reading it.
    pub fn peek(&mut self, at: u64, address: u64) -> Option<u64> {
        self.chip.peek(VirtualNanos(at), address, Width::W32).ok()
    }
}

impl machine::Board for Rig {
    fn name(&self) -> &'static str {
        "rig"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec!["mcu"]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.chip)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let mut core = each!(&mut self.chip.part, b => machine::Board::targets(&mut **b).remove(0).core);
        core.instructions_per_second = self.instructions_per_second.try_into().expect("not zero");
        core.processor = cpu::with_regions(core.processor, self.memory.clone());
        vec![Target::new("mcu", &mut self.chip, core)]
    }
}
