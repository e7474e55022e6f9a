//! The library inside an Embassy firmware of your own: one ZK engine on USART1 of an STM32H743.
//!
//! A package of its own, with its own tick rate and without defmt: `cargo build --release` in this folder.
//! `docs/porting.md` of jetlink walks through it.
#![no_std]
#![no_main]

use embassy_executor::Spawner;
use embassy_stm32::usart::{self, BufferedInterruptHandler, BufferedUart};
use embassy_stm32::{bind_interrupts, peripherals};
use embassy_time::{Duration, Ticker};
use jetlink::channel::{Channel, Source};
use jetlink::command::{Command, Origin};
use jetlink::config::{EngineConfig, check};
use jetlink::ecu::zk::codec::Rate;
use jetlink::engine::retained::{Reset, RetainedMemory};
use jetlink::line::Line;
use jetlink::runner::{LineErrors, Runner};
use static_cell::StaticCell;

// 1. The engine. `check` finds a mistake in it while this compiles.
const ENGINE: EngineConfig = EngineConfig::zk("engine", 0, Line::new(9600), Rate::Hz50);
const _: () = check(&[ENGINE]);

bind_interrupts!(struct Irqs {
    USART1 => BufferedInterruptHandler<peripherals::USART1>;
});

// 2. What has to survive a reset: order, demand, source, arming, a latched emergency stop.
// SAFETY: cortex-m-rt's section `.uninit` is RAM that start-up leaves as it is. Every bit pattern is a valid
// `RetainedMemory` (it is atomics throughout), and its content is only used with a right checksum.
#[unsafe(link_section = ".uninit.retained")]
static RETAINED: RetainedMemory = RetainedMemory::new();

// Which part of it is used: after a power-up or a brown-out nothing that could start or raise an engine, because the
// RAM may have been without power. The chip's flags stay on until they are cleared.
fn reset() -> Reset {
    let rcc = embassy_stm32::pac::RCC;
    let flags = rcc.rsr().read();
    rcc.rsr().modify(|w| w.set_rmvf(true));
    let warm = flags.iwdg1rstf() || flags.wwdg1rstf() || flags.sftrstf() || flags.pinrstf();
    if warm && !flags.porrstf() && !flags.borrstf() { Reset::Warm } else { Reset::PowerLost }
}

// 3. A task that owns the UART. It needs a higher priority than anything that computes for long: see how the firmware of
//    jetlink uses an InterruptExecutor.
#[embassy_executor::task]
async fn engine(runner: Runner<'static>, uart: BufferedUart<'static>) {
    // Where the driver returns line errors, or nobody counts them, an empty counter does.
    static ERRORS: LineErrors = LineErrors::new();
    let (tx, rx) = uart.split();
    runner.run(rx, tx, &ERRORS).await
}

// 4. Code that commands holds a source, of which there is one. This one commands standby: the second command also shuts down
//    an engine that resumed after a reset.
#[embassy_executor::task]
async fn pilot(source: Source<'static>) {
    let mut tick = Ticker::every(Duration::from_millis(100));
    loop {
        // The engine's events also report what is refused.
        let _ = source.command(Command::Standby);
        let _rpm = source.handle().telemetry().report.rpm;
        tick.next().await;
    }
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let p = embassy_stm32::init(embassy_stm32::Config::default());

    let mut config = usart::Config::default();
    config.baudrate = ENGINE.line.baud;
    // 3. Every byte as it comes: without this the reader wakes at the idle line, too late for AMT.
    config.eager_reads = Some(1);
    static TX: StaticCell<[u8; 32]> = StaticCell::new();
    static RX: StaticCell<[u8; 256]> = StaticCell::new();
    let (tx, rx) = (TX.init([0; 32]), RX.init([0; 256]));
    let uart = BufferedUart::new(p.USART1, p.PA10, p.PA9, tx, rx, Irqs, config).unwrap();

    static CHANNEL: StaticCell<Channel> = StaticCell::new();
    let channel: &'static Channel = CHANNEL.init(Channel::new(&ENGINE, Some((&RETAINED, reset()))));
    spawner.spawn(engine(channel.runner(), uart).unwrap());
    spawner.spawn(pilot(channel.owner().source(Origin::Bench).unwrap()).unwrap());
    // 5. A watchdog is fed only while `jetlink::watch::RunnerWatch` finds no runner stuck. There is none here: see
    //    `supervisor` in jetlink's src/firmware.rs.
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    cortex_m::peripheral::SCB::sys_reset()
}
