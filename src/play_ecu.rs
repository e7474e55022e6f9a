//! Bench only (feature `play-ecu`): the last ECU port of the board plays an AMT ECU at rest. Cross-connected to the port of an
//! AMT engine, it shows a whole link on a single board; the log has the time from the end of a frame to the reply. Its engine
//! never runs: the state is always "no start clearance", with 0 rpm and a cold exhaust.

use crate::board::EcuPort;
use embassy_time::{Duration, Instant, Ticker, with_timeout};
use embedded_io_async::{Read, Write};
use jetlink::line::Line;

/// The ECU's default.
pub const LINE: Line = Line::new(2400);

/// Duration of a byte on it: 10 bits.
const BYTE: Duration = Duration::from_micros(4167);

/// A normal set: no start clearance, auto stop, 0 rpm, 19 °C, 0 % (AMT-3, AMT-7).
const FRAME: [u8; 6] = [0xFF, 0x02, 0x00, 0x0F, 0x00, 0x00];

/// Interval of frames (AMT-12).
const PERIOD: Duration = Duration::from_millis(125);

/// Reply window, from the end of a frame to the end of its reply (AMT-11).
const WINDOW: Duration = Duration::from_millis(30);

/// Bytes of a reply.
const REPLY: usize = 5;

/// Sends frames forever, and logs the replies once a second.
#[expect(clippy::disallowed_methods, reason = "an ECU keeps its own time")]
pub async fn play(mut port: EcuPort) -> ! {
    let mut tick = Ticker::every(PERIOD);
    let (mut frames, mut replies) = (0_u32, 0_u32);
    loop {
        let mut longest = Duration::MIN;
        for _ in 0..8 {
            tick.next().await;
            // Discard late bytes: they belong to no frame.
            while with_timeout(Duration::MIN, port.rx.read(&mut [0; REPLY])).await.is_ok() {}
            if port.tx.write_all(&FRAME).await.is_err() || port.tx.flush().await.is_err() {
                continue;
            }
            frames += 1;
            let end = Instant::now();
            if let Ok(start) = with_timeout(WINDOW, reply(&mut port, end)).await {
                replies += 1;
                longest = longest.max(start);
            }
        }
        defmt::info!(
            "played ECU: {=u32} frames, {=u32} replies in time, the longest of the last 8 began after {=u64} us",
            frames,
            replies,
            longest.as_micros()
        );
    }
}

/// Reads a whole reply. Returns the time from `end` to its first start bit.
#[expect(clippy::disallowed_methods, reason = "an ECU keeps its own time")]
async fn reply(port: &mut EcuPort, end: Instant) -> Duration {
    let mut bytes = [0; REPLY];
    let mut start = None;
    let mut count = 0;
    while count < REPLY {
        // The port counts line errors; an empty read is not an error.
        count += port.rx.read(&mut bytes[count..]).await.unwrap_or(0);
        start.get_or_insert_with(|| Instant::now().duration_since(end));
    }
    start.unwrap_or(BYTE).checked_sub(BYTE).unwrap_or(Duration::MIN)
}
