//! F-RAM on a mock of the chip, written from its data sheets: byte by byte, with a power cut at each byte.

use super::store::rewrite;
use crate::fram::{CHIPS, Chip, Fram, Maker, NotUsed};
use crate::store::{AtRest, Found, NotSaved, Store};
use embassy_futures::block_on;
use embedded_hal::spi::{ErrorKind, ErrorType, Operation, SpiDevice};
use embedded_storage_async::nor_flash::{NorFlash, ReadNorFlash};
use std::collections::BTreeMap;
use std::vec::Vec;

/// The chip, and the state of its pins.
#[derive(Clone, Debug)]
struct Mock {
    id: Vec<u8>,
    address: usize,
    memory: Vec<u8>,
    status: u8,
    enabled: bool,
    /// The pin WP locks the status register.
    locked: bool,
    /// It ignores writes: bytes read back unchanged.
    stuck: bool,
    /// Reads of its memory fail.
    unreadable: bool,
    /// Bytes that are written until the power fails.
    left: Option<usize>,
    written: usize,
    read: usize,
}

impl Mock {
    fn new(chip: Chip) -> Self {
        let id = match chip.maker {
            Maker::Cypress => [&[0x7F; 6][..], &[0xC2], &chip.product].concat(),
            Maker::Fujitsu => [&[0x04, 0x7F][..], &chip.product].concat(),
        };
        Self {
            id,
            address: chip.address.into(),
            memory: std::vec![0; usize::from(chip.kib) * 1024],
            status: 0,
            enabled: false,
            locked: false,
            stuck: false,
            unreadable: false,
            left: None,
            written: 0,
            read: 0,
        }
    }

    /// One selection: the bytes received, and the number of bytes to return.
    fn selected(&mut self, sent: &[u8], wanted: usize) -> Result<Vec<u8>, ErrorKind> {
        if self.left == Some(0) {
            return Err(ErrorKind::Other);
        }
        let Some((command, rest)) = sent.split_first() else { return Ok(std::vec![0xFF; wanted]) };
        let address = |rest: &[u8]| {
            let (address, data) = rest.split_at(self.address);
            let at = address.iter().fold(0, |at, byte| at << 8 | usize::from(*byte));
            (at % self.memory.len(), data.to_vec())
        };
        match *command {
            // WREN.
            0x06 => self.enabled = true,
            // RDSR: the latch is bit 1.
            0x05 => return Ok(std::vec![self.status | u8::from(self.enabled) << 1; wanted]),
            // WRSR.
            0x01 => {
                if core::mem::take(&mut self.enabled) && !(self.locked && self.status & 0x80 != 0) {
                    self.status = rest[0] & 0b1000_1100;
                }
            }
            0x9F => {
                return Ok(self.id.iter().copied().chain(core::iter::repeat(0xFF)).take(wanted).collect());
            }
            0x03 if self.unreadable => return Err(ErrorKind::Other),
            0x03 => {
                let (at, _) = address(rest);
                self.read += wanted;
                return Ok((0..wanted).map(|i| self.memory[(at + i) % self.memory.len()]).collect());
            }
            0x02 => {
                let (at, data) = address(rest);
                // Protects the whole chip: the individual blocks do not matter here.
                if !core::mem::take(&mut self.enabled) || self.status & 0b1100 != 0 || self.stuck {
                    return Ok(Vec::new());
                }
                for (i, byte) in data.into_iter().enumerate() {
                    if let Some(left) = &mut self.left {
                        if *left == 0 {
                            return Err(ErrorKind::Other);
                        }
                        *left -= 1;
                    }
                    let at = (at + i) % self.memory.len();
                    self.memory[at] = byte;
                    self.written += 1;
                }
                if self.left == Some(0) {
                    return Err(ErrorKind::Other);
                }
            }
            other => panic!("no command of the data sheets: {other:02X}"),
        }
        Ok(Vec::new())
    }
}

impl ErrorType for Mock {
    type Error = ErrorKind;
}

impl SpiDevice for Mock {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
        let mut sent = Vec::new();
        for operation in operations.iter() {
            if let Operation::Write(bytes) = operation {
                sent.extend_from_slice(bytes);
            }
        }
        match operations.last_mut() {
            Some(Operation::Read(into)) => into.copy_from_slice(&self.selected(&sent, into.len())?),
            _ => drop(self.selected(&sent, 0)?),
        }
        Ok(())
    }
}

/// The smallest chip of either form, and one with addresses of 3 bytes.
fn some() -> [Chip; 3] {
    [CHIPS[1], CHIPS[13], CHIPS[9]]
}

#[test]
fn every_known_chip_is_recognised_and_holds_both_sectors() {
    for chip in CHIPS {
        let (mut fram, found) = Fram::find(Mock::new(chip)).unwrap();
        assert_eq!(found, chip);
        // Each word is its own: no address wraps, and none is cut off.
        for at in (0..fram.capacity() as u32).step_by(1024) {
            block_on(fram.write(at, &at.to_le_bytes())).unwrap();
        }
        let mut bytes = [0; 4];
        for at in (0..fram.capacity() as u32).step_by(1024) {
            block_on(fram.read(at, &mut bytes)).unwrap();
            assert_eq!(u32::from_le_bytes(bytes), at, "{chip:?}");
        }
        assert!(block_on(fram.read(fram.capacity() as u32 - 3, &mut bytes)).is_err(), "behind its end");
        assert!(block_on(fram.write(fram.capacity() as u32, &bytes)).is_err());
    }
}

#[test]
fn an_unknown_or_missing_chip_is_not_used() {
    let good = Mock::new(CHIPS[3]);
    for id in [[0xFF; 9], [0; 9], [0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0xC2, 0x2A, 0x08]] {
        let mock = Mock { id: id.to_vec(), ..good.clone() };
        let why = Fram::find(mock).err();
        assert_eq!(why, Some(NotUsed::Unknown(id)));
        assert_eq!(why.map(NotUsed::may_have_settings), Some(false), "{id:02x?}");
    }
    // A product of one manufacturer is not one of the other.
    let mock = Mock { id: std::vec![0x04, 0x7F, 0x22, 0x08], ..good.clone() };
    assert!(matches!(Fram::find(mock).err(), Some(NotUsed::Unknown(_))));
    assert_eq!(Fram::find(Mock { left: Some(0), ..good }).err(), Some(NotUsed::Bus));
    assert!(NotUsed::Bus.may_have_settings() && NotUsed::Protected.may_have_settings());
}

#[test]
fn protection_is_cleared_and_one_that_is_locked_is_not_used() {
    for chip in some() {
        let mock = Mock { status: 0b1000_1100, ..Mock::new(chip) };
        let (mut fram, _) = Fram::find(mock.clone()).unwrap();
        block_on(fram.write(0, b"mine")).unwrap();
        assert_eq!(fram.into_device().status, 0);
        assert_eq!(Fram::find(Mock { locked: true, ..mock }).err(), Some(NotUsed::Protected));
    }
}

#[test]
fn what_does_not_read_back_as_it_was_written_is_an_error() {
    let (mut fram, _) = Fram::find(Mock { stuck: true, ..Mock::new(CHIPS[1]) }).unwrap();
    assert!(block_on(fram.write(0, b"mine")).is_err());
    assert!(block_on(fram.erase(0, 8192)).is_err());
    // Bytes that already match need no write.
    block_on(fram.write(0, &[0; 4])).unwrap();
}

type Records = BTreeMap<u8, Vec<u8>>;

fn load(mock: Mock, at_rest: &AtRest) -> (Store<'_, Fram<Mock>>, Found, Records) {
    let mut records = Records::new();
    let (fram, _) = Fram::find(mock).unwrap();
    let (store, found) = block_on(Store::load(fram, at_rest, &mut |key, record| {
        records.insert(key, record.to_vec());
    }));
    (store, found, records)
}

#[test]
fn after_a_power_cut_at_any_byte_no_record_is_lost_or_old() {
    let at_rest = AtRest::new();
    at_rest.set(true);
    let changes: Vec<(u8, Vec<u8>)> = (0..60)
        .map(|i: u8| (i % 4, (0..200_u8).map(|j| i.wrapping_mul(7).wrapping_add(j)).collect()))
        .collect();
    let chip = some()[1];
    let save_all = |store: &mut Store<'_, Fram<Mock>>| {
        let (mut before, mut after) = (Records::new(), Records::new());
        for (key, record) in &changes {
            after.insert(*key, record.clone());
            if block_on(store.save(*key, record)).is_err() {
                break;
            }
            before.insert(*key, record.clone());
        }
        (before, after)
    };
    let (mut store, found, _) = load(Mock::new(chip), &at_rest);
    assert_eq!(found, Found::Empty);
    let (before, _) = save_all(&mut store);
    assert_eq!(before.len(), 4);
    let all = store.into_flash().into_device().written;
    // Every byte of the first and the last writes; others, including those of moves, at random.
    let mut rng = fastrand::Rng::with_seed(5);
    let some = (0..100).map(|_| rng.usize(0..all));
    let cuts: Vec<usize> = (0..300).chain(all - 60..all).chain(some).collect();
    for cut in cuts {
        let (mut store, _, _) = load(Mock::new(chip), &at_rest);
        let mut mock = store.into_flash().into_device();
        mock.left = Some(cut + 1);
        (store, _, _) = load(mock, &at_rest);
        let (before, after) = save_all(&mut store);
        let mock = Mock { left: None, enabled: false, ..store.into_flash().into_device() };
        at_rest.set(false);
        let (store, found, records) = load(mock, &at_rest);
        assert!(records == before || records == after, "cut at byte {cut}: {:?}", records.keys());
        let expected = if records.is_empty() { Found::Empty } else { Found::Whole };
        assert_eq!(found, expected, "cut at byte {cut}");
        at_rest.set(true);
        let (mut store, _, _) = load(store.into_flash().into_device(), &at_rest);
        if block_on(store.save(1, b"later")).is_err() {
            let later = [(1, b"later".to_vec())];
            rewrite(&mut store, &records.into_iter().chain(later).collect()).unwrap();
        }
        let (_, found, now) = load(store.into_flash().into_device(), &at_rest);
        assert_eq!((found, now.get(&1)), (Found::Whole, Some(&b"later".to_vec())), "cut at byte {cut}");
    }
}

#[test]
fn a_chip_of_which_no_read_succeeds_is_damaged() {
    let at_rest = AtRest::new();
    at_rest.set(true);
    for chip in some() {
        let (mut store, ..) = load(Mock::new(chip), &at_rest);
        rewrite(&mut store, &Records::from([(0, b"mine".to_vec())])).unwrap();
        let mock = store.into_flash().into_device();
        for (mock, found) in [(Mock::new(chip), Found::Empty), (mock, Found::Whole)] {
            assert_eq!(load(mock.clone(), &at_rest).1, found);
            let (mut store, found, _) = load(Mock { unreadable: true, ..mock }, &at_rest);
            assert_eq!(found, Found::Damaged);
            assert_eq!(block_on(store.save(0, b"new")), Err(NotSaved::Failed));
        }
    }
}

/// The engines' tasks start after it.
#[test]
fn a_start_reads_little() {
    let at_rest = AtRest::new();
    let mut rng = fastrand::Rng::with_seed(9);
    let read = |mock: Mock| {
        let (store, found, _) = load(Mock { read: 0, ..mock }, &at_rest);
        (found, store.into_flash().into_device())
    };
    for chip in some() {
        let mut mock = Mock::new(chip);
        mock.memory.fill(0xFF);
        let (found, erased) = read(mock.clone());
        assert_eq!((found, erased.written), (Found::Empty, 0));
        assert!(erased.read <= 512, "{} bytes", erased.read);
        let (mut store, _, _) = load(mock, &at_rest);
        for key in 0..5 {
            block_on(store.save(key, &[key; 200])).unwrap();
        }
        let (found, ours) = read(store.into_flash().into_device());
        assert_eq!(found, Found::Whole);
        assert!(ours.read <= 4096, "{} bytes", ours.read);
        // Each word is read once, and again if it is not the head of a record: the first read may have failed.
        let mut mock = Mock::new(chip);
        mock.memory.iter_mut().for_each(|byte| *byte = rng.u8(..));
        let before = mock.memory.clone();
        let (found, foreign) = read(mock);
        assert_eq!((found, foreign.written), (Found::Empty, 0));
        assert!(foreign.read <= 2 * 16 * 1024 + 2048 && foreign.memory == before, "{} bytes", foreign.read);
    }
}

#[test]
fn somebody_elses_data_is_overwritten_by_a_save_at_rest_only() {
    let at_rest = AtRest::new();
    let mut mock = Mock::new(some()[0]);
    mock.memory.iter_mut().enumerate().for_each(|(at, byte)| *byte = (at * 7 + at / 256) as u8);
    let before = mock.memory.clone();
    let (mut store, found, _) = load(mock, &at_rest);
    assert_eq!(found, Found::Empty);
    assert_eq!(block_on(store.save(0, b"mine")), Err(NotSaved::Full));
    assert_eq!(block_on(store.begin_rewrite()), Err(NotSaved::Full));
    let mock = store.into_flash().into_device();
    assert_eq!((mock.written, &mock.memory), (0, &before));
    at_rest.set(true);
    let (mut store, _, _) = load(mock, &at_rest);
    if block_on(store.save(0, b"mine")).is_err() {
        rewrite(&mut store, &Records::from([(0, b"mine".to_vec())])).unwrap();
    }
    let (_, found, records) = load(store.into_flash().into_device(), &at_rest);
    assert_eq!((found, records), (Found::Whole, Records::from([(0, b"mine".to_vec())])));
}

/// The emulated boards have no USB, so a key cannot be set: one of them finds this one in its F-RAM (emulation/tests/pymavlink.rs).
/// `JETLINK_WRITE=1` writes it.
#[test]
#[cfg(feature = "signing")]
fn emulated_board_has_a_key_as_the_store_keeps_one() {
    use crate::signing::{Key, Stamp};
    use std::string::String;
    let at_rest = AtRest::new();
    at_rest.set(true);
    let mut mock = Mock::new(CHIPS[1]);
    mock.memory.fill(0xFF);
    let (mut store, ..) = load(mock, &at_rest);
    let key = Key::new(core::array::from_fn(|i| i as u8 + 1));
    let stamp = Stamp::new(36_500_000_000_000).unwrap();
    let record = crate::record::of_signing(key.as_ref(), stamp);
    block_on(store.save(crate::record::SIGNING_KEY, &record)).unwrap();
    let memory = store.into_flash().into_device().memory;
    let end = memory.iter().rposition(|&byte| byte != 0xFF).unwrap() + 1;
    let lines = memory[..end].chunks(32).map(|line| {
        let digits = line.iter().map(|byte| std::format!("{byte:02x}"));
        digits.collect::<String>() + "\n"
    });
    let text: String = lines.collect();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../emulation/tests/signing-key.hex");
    if std::env::var_os("JETLINK_WRITE").is_some() {
        std::fs::write(path, &text).unwrap();
    }
    assert_eq!(std::fs::read_to_string(path).unwrap(), text);
}
