//! The library inside somebody's own Embassy firmware: one ZK engine on USART1 of an STM32H743.
//!
//! It compiles for the board (`cargo build --release --target thumbv7em-none-eabihf --package jetlink --features
//! board-matek-h743 --example own_firmware`); on the host it is a stub. `docs/porting.md` walks through it.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod firmware {
    use defmt_rtt as _;
    use embassy_executor::Spawner;
    use embassy_stm32::usart::{self, BufferedInterruptHandler, BufferedUart};
    use embassy_stm32::{bind_interrupts, peripherals};
    use embassy_time::{Duration, Ticker};
    use jetlink::channel::{Channel, Handle};
    use jetlink::command::{Command, Origin};
    use jetlink::config::{EngineConfig, check};
    use jetlink::ecu::zk::codec::Rate;
    use jetlink::engine::keep::{Memory, Reset};
    use jetlink::line::Line;
    use jetlink::runner::{LineErrors, Runner};
    use static_cell::StaticCell;

    // 1. The engine. `check` finds a mistake in it while this compiles.
    const ENGINE: EngineConfig = EngineConfig::zk("engine", 0, Line::new(9600), Rate::Hz50);
    const _: () = check(&[ENGINE]);

    bind_interrupts!(struct Irqs {
        USART1 => BufferedInterruptHandler<peripherals::USART1>;
    });

    // 2. What has to survive a reset: order, demand, source, arming, a latched emergency stop. With `Channel::new`
    //    all of it would be forgotten at every reset.
    // SAFETY: cortex-m-rt's section `.uninit` is RAM that start-up leaves as it is. Every bit pattern is a valid
    // `Memory` (it is atomics throughout), and what it holds is only believed with a right checksum.
    #[unsafe(link_section = ".uninit.kept")]
    static KEPT: Memory = Memory::new();

    // What of it may be believed: after a power-up or a brown-out nothing that could start or raise an engine, because the
    // RAM may have been without power. The chip's flags stay on until they are cleared.
    fn reset() -> Reset {
        let rcc = embassy_stm32::pac::RCC;
        let flags = rcc.rsr().read();
        rcc.rsr().modify(|w| w.set_rmvf(true));
        let warm = flags.iwdg1rstf() || flags.wwdg1rstf() || flags.sftrstf() || flags.pinrstf();
        if warm && !flags.porrstf() && !flags.borrstf() { Reset::Warm } else { Reset::PowerLost }
    }

    // 3. A task that owns the UART. It wants a higher priority than whatever computes for long: see how
    //    src/firmware.rs uses an InterruptExecutor.
    #[embassy_executor::task]
    async fn engine(runner: Runner<'static>, uart: BufferedUart<'static>) {
        // Where the driver returns line errors, or nobody counts them, an empty counter does.
        static ERRORS: LineErrors = LineErrors::new();
        let (tx, rx) = uart.split();
        runner.run(rx, tx, &ERRORS).await
    }

    // 4. Anything that commands or listens has a handle; they can be copied. This one commands standby: the second word
    //    also shuts down an engine that went on after a reset.
    #[embassy_executor::task]
    async fn pilot(handle: Handle<'static>) {
        let mut tick = Ticker::every(Duration::from_millis(100));
        loop {
            if let Err(why) = handle.command(Command::Standby, Origin::Bench) {
                defmt::warn!("refused: {}", why);
            }
            defmt::info!("rpm {}", handle.telemetry().report.rpm);
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
        let uart = defmt::unwrap!(BufferedUart::new(p.USART1, p.PA10, p.PA9, tx, rx, Irqs, config));

        static CHANNEL: StaticCell<Channel> = StaticCell::new();
        let channel: &'static Channel = CHANNEL.init(Channel::with_memory(&ENGINE, &KEPT, reset()));
        spawner.spawn(defmt::unwrap!(engine(channel.runner(), uart)));
        spawner.spawn(defmt::unwrap!(pilot(channel.handle())));
        // 5. A watchdog is fed only while `channel.handle().progress()` changes. There is none here: see
        //    `supervisor` in src/firmware.rs.
    }

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo) -> ! {
        cortex_m::peripheral::SCB::sys_reset()
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("This is firmware for a board: see the first lines of examples/own_firmware.rs.");
}
