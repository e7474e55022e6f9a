//! Records on a mock of an STM32H7's flash: words of 32 bytes that can be written once between two erases, and are unreadable
//! after a power cut has torn them.

use super::world::*;
use crate::record;
use crate::service::ParameterStorage;
use crate::settings::{EngineSettings, NodeSettings, Table, find_row};
use crate::store::{AtRest, Flash, Found, NotSaved, Store};
use embassy_futures::block_on;
use embassy_time::{Duration, Instant, Timer};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use fastrand::Rng;
use jetlink::config::{EngineConfig, validate};
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::Line;
use jetlink::setting::Row;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::string::String;
use std::vec::Vec;

const WORD: usize = 32;
const SECTOR: usize = 1024;

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Word {
    Holds([u8; WORD]),
    /// Two wrong bits: every read fails.
    Torn,
}

const EMPTY: Word = Word::Holds([0xFF; WORD]);

#[derive(Clone, Debug)]
pub struct Mock<'a> {
    pub words: Vec<Word>,
    /// Number of writes and erases until the power fails; the last one is torn.
    pub left: Option<usize>,
    /// Writes and erases so far.
    pub done: usize,
    pub erases: usize,
    /// Writes, or erases, have no effect and report success.
    pub takes_no_write: bool,
    pub takes_no_erase: bool,
    /// The power has failed.
    pub off: Rc<Cell<bool>>,
    /// Erases fail.
    pub refuses_erase: Rc<Cell<bool>>,
    /// Time that an erase takes.
    pub erase_time: Option<Duration>,
    pub rng: Rng,
    pub at_rest: &'a AtRest,
}

impl<'a> Mock<'a> {
    pub fn new(at_rest: &'a AtRest) -> Self {
        let words = std::vec![EMPTY; 2 * SECTOR / WORD];
        Self {
            words,
            left: None,
            done: 0,
            erases: 0,
            takes_no_write: false,
            takes_no_erase: false,
            off: Rc::default(),
            refuses_erase: Rc::default(),
            erase_time: None,
            rng: Rng::with_seed(1),
            at_rest,
        }
    }

    /// Effect of a power cut on a word that would have become `new`.
    fn tear(&mut self, old: Word, new: Word) -> Word {
        match self.rng.u8(0..4) {
            0 => old,
            1 => new,
            2 => Word::Torn,
            // Some of its bits, readable by chance.
            _ => match (old, new) {
                (Word::Holds(old), Word::Holds(new)) => {
                    let mask: u8 = self.rng.u8(..);
                    Word::Holds(std::array::from_fn(|i| old[i] & mask | new[i] & !mask))
                }
                _ => Word::Torn,
            },
        }
    }

    /// Whether the power fails in this operation; an error if it has failed before.
    fn cut(&mut self) -> Result<bool, NorFlashErrorKind> {
        match &mut self.left {
            Some(0) => Err(NorFlashErrorKind::Other),
            Some(left) => {
                *left -= 1;
                self.off.set(*left == 0);
                Ok(*left == 0)
            }
            None => {
                self.done += 1;
                Ok(false)
            }
        }
    }
}

impl ErrorType for Mock<'_> {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Mock<'_> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, at: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        for (byte, at) in bytes.iter_mut().zip(at as usize..) {
            match self.words[at / WORD] {
                Word::Holds(word) => *byte = word[at % WORD],
                Word::Torn => return Err(NorFlashErrorKind::Other),
            }
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        2 * SECTOR
    }
}

impl NorFlash for Mock<'_> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        assert!(self.at_rest.get(), "an erase in flight");
        if self.refuses_erase.get() {
            return Err(NorFlashErrorKind::Other);
        }
        self.erases += 1;
        if let Some(time) = self.erase_time {
            Timer::after(time).await;
        }
        let cut = self.cut()?;
        if self.takes_no_erase {
            return Ok(());
        }
        for word in from as usize / WORD..to as usize / WORD {
            self.words[word] = if cut { self.tear(self.words[word], EMPTY) } else { EMPTY };
        }
        if cut { Err(NorFlashErrorKind::Other) } else { Ok(()) }
    }

    async fn write(&mut self, at: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        for (chunk, word) in bytes.chunks(WORD).zip(at as usize / WORD..) {
            assert_eq!(self.words[word], EMPTY, "a word is written once");
            let cut = self.cut()?;
            if self.takes_no_write {
                return Ok(());
            }
            let new = Word::Holds(chunk.try_into().unwrap());
            self.words[word] = if cut { self.tear(EMPTY, new) } else { new };
            if cut {
                return Err(NorFlashErrorKind::Other);
            }
        }
        Ok(())
    }
}

impl Flash for Mock<'_> {}

pub type Records = BTreeMap<u8, Vec<u8>>;

pub fn load<'a>(mock: Mock<'a>, at_rest: &'a AtRest) -> (Store<'a, Mock<'a>>, Found, Records) {
    let mut records = Records::new();
    let (store, found) = block_on(Store::load(mock, at_rest, &mut |key, record| {
        assert!(records.insert(key, record.to_vec()).is_none(), "twice");
    }));
    (store, found, records)
}

/// Rewrites all records, as the runner does: the first one last, and once more, which erases the previous ones.
pub fn rewrite<F: Flash>(store: &mut Store<'_, F>, records: &Records) -> Result<(), NotSaved> {
    block_on(store.begin_rewrite())?;
    for (left, (key, record)) in records.iter().enumerate().rev() {
        if left == 0 {
            store.end_rewrite();
        }
        block_on(store.save(*key, record))?;
    }
    records.iter().take(1).try_for_each(|(key, record)| block_on(store.save(*key, record)))
}

/// A user's changes: key and record.
fn changes(count: usize) -> Vec<(u8, Vec<u8>)> {
    let mut rng = Rng::with_seed(7);
    (0..count).map(|i| (rng.u8(0..5), (0..rng.usize(1..100)).map(|j| (i * 7 + j) as u8).collect())).collect()
}

#[test]
fn after_a_power_cut_at_any_write_or_erase_no_record_is_lost_or_old() {
    let at_rest = AtRest::new();
    at_rest.set(true);
    let changes = changes(40);
    // Without a cut, for the number of operations.
    let (mut store, found, _) = load(Mock::new(&at_rest), &at_rest);
    assert_eq!(found, Found::Empty);
    for (key, record) in &changes {
        block_on(store.save(*key, record)).unwrap();
    }
    let whole = store.into_flash();
    assert!(whole.erases >= 5, "{} migrations", whole.erases);
    std::println!("{} writes and erases, {} erases", whole.done, whole.erases);

    for (cut, seed) in (1..=whole.done).flat_map(|cut| (0..2).map(move |seed| (cut, seed))) {
        let mock = Mock { left: Some(cut), rng: Rng::with_seed(seed), ..Mock::new(&at_rest) };
        let (mut store, _, _) = load(mock, &at_rest);
        let mut before = Records::new();
        let mut after = Records::new();
        for (key, record) in &changes {
            after.insert(*key, record.clone());
            if block_on(store.save(*key, record)).is_err() {
                break;
            }
            before.insert(*key, record.clone());
        }
        let case = std::format!("cut at operation {cut}, seed {seed}");
        let mock = Mock { left: None, ..store.into_flash() };
        // In flight it is read, and nothing is erased: the mock would report an erase.
        at_rest.set(false);
        let (store, found, records) = load(mock, &at_rest);
        assert!(records == before || records == after, "{case}: {records:?}");
        let expected = if records.is_empty() { Found::Empty } else { Found::Whole };
        assert_eq!(found, expected, "{case}");
        // At rest it continues, over a whole sector.
        at_rest.set(true);
        let (mut store, _, mut records) = load(store.into_flash(), &at_rest);
        for (key, record) in changes.iter().take(20) {
            records.insert(*key, record.clone());
            if block_on(store.save(*key, record)).is_err() {
                // A word that looks empty to the crate, but is not.
                rewrite(&mut store, &records).unwrap();
            }
        }
        let (_, found, now) = load(store.into_flash(), &at_rest);
        assert_eq!((found, now), (Found::Whole, records), "{case}");
    }
}

#[test]
fn a_full_store_refuses_in_flight_and_takes_it_at_rest() {
    let at_rest = AtRest::new();
    let (mut store, _, _) = load(Mock::new(&at_rest), &at_rest);
    let mut expected = Records::new();
    let mut refused = 0;
    for (key, record) in changes(40) {
        match block_on(store.save(key, &record)) {
            Ok(()) => drop(expected.insert(key, record)),
            Err(why) => {
                assert_eq!(why, NotSaved::Full);
                refused += 1;
            }
        }
    }
    assert!(refused > 10, "{refused}");
    let (mut store, found, records) = load(store.into_flash(), &at_rest);
    assert_eq!((found, &records), (Found::Whole, &expected));
    at_rest.set(true);
    for (key, record) in changes(40) {
        block_on(store.save(key, &record)).unwrap();
        expected.insert(key, record);
    }
    let (_, found, records) = load(store.into_flash(), &at_rest);
    assert_eq!((found, records), (Found::Whole, expected));
}

#[test]
fn what_is_saved_already_is_not_written_again() {
    let at_rest = AtRest::new();
    let (mut store, _, _) = load(Mock::new(&at_rest), &at_rest);
    block_on(store.save(3, b"one")).unwrap();
    let mock = store.into_flash();
    let done = mock.done;
    let (mut store, _, _) = load(mock, &at_rest);
    block_on(store.save(3, b"one")).unwrap();
    assert_eq!(store.into_flash().done, done);
}

#[test]
fn empty_and_damaged_differ() {
    let at_rest = AtRest::new();
    at_rest.set(true);
    let (mut store, _, _) = load(Mock::new(&at_rest), &at_rest);
    for key in 0..5 {
        block_on(store.save(key, &[key; 40])).unwrap();
    }
    let mock = store.into_flash();
    let used = mock.words.iter().rposition(|&word| word != EMPTY).unwrap();
    // A mark, and three words for each record. The loss of each word is noticed, except the mark and the words of the last
    // record.
    for word in 1..used - 2 {
        for damage in [Word::Torn, Word::Holds([0x5A; WORD])] {
            let mut mock = mock.clone();
            mock.words[word] = damage;
            let (_, found, records) = load(mock, &at_rest);
            assert_eq!((found, records.len()), (Found::Damaged, 4), "word {word}");
        }
    }
    // It is entirely unreadable or wrong: only its mark and its length identify it.
    const WRONG: Word = Word::Holds([0x5A; WORD]);
    let marked = mock.words[0];
    for (mark, damage, expected) in [
        (marked, Word::Torn, Found::Damaged),
        (marked, WRONG, Found::Damaged),
        (Word::Torn, Word::Torn, Found::Damaged),
        (WRONG, WRONG, Found::Empty),
    ] {
        for other_sector in [false, true] {
            let mut mock = mock.clone();
            mock.words[..=used].fill(damage);
            mock.words[0] = mark;
            if other_sector {
                mock.words.rotate_left(SECTOR / WORD);
            }
            let (_, found, records) = load(mock, &at_rest);
            assert_eq!((found, records.len()), (expected, 0), "{mark:?} {damage:?}");
        }
    }
    // A first record torn by a power cut is not damage.
    let mut first = Mock::new(&at_rest);
    first.words[..11].fill(Word::Torn);
    first.words[0] = marked;
    assert_eq!(load(first, &at_rest).1, Found::Empty);
    // Zeros belong to nobody.
    let mut zeros = Mock::new(&at_rest);
    zeros.words.fill(Word::Holds([0; WORD]));
    assert_eq!(load(zeros, &at_rest).1, Found::Empty);
    // Another program's data is not a record of ours, and is overwritten when permitted.
    let mut rng = Rng::with_seed(3);
    for _ in 0..200 {
        let mut mock = Mock::new(&at_rest);
        mock.words.iter_mut().for_each(|word| *word = Word::Holds(std::array::from_fn(|_| rng.u8(..))));
        let (mut store, found, records) = load(mock, &at_rest);
        assert_eq!((found, records.len()), (Found::Empty, 0));
        at_rest.set(false);
        assert_eq!(block_on(store.save(0, b"mine")), Err(NotSaved::Full));
        assert_eq!(block_on(store.begin_rewrite()), Err(NotSaved::Full));
        at_rest.set(true);
        if block_on(store.save(0, b"mine")).is_err() {
            rewrite(&mut store, &Records::from([(0, b"mine".to_vec())])).unwrap();
        }
        assert_eq!(load(store.into_flash(), &at_rest).1, Found::Whole);
    }
}

#[test]
fn what_is_damaged_stays_damaged_until_all_is_rewritten() {
    let at_rest = AtRest::new();
    at_rest.set(true);
    let (mut store, _, _) = load(Mock::new(&at_rest), &at_rest);
    for key in 0..3 {
        block_on(store.save(key, &[key; 40])).unwrap();
    }
    let mut mock = store.into_flash();
    // The first word is a mark, the next one begins the first record.
    mock.words[1] = Word::Torn;
    let (mut store, found, _) = load(mock, &at_rest);
    assert_eq!(found, Found::Damaged);
    // Enough for a move to the other sector and back: no save repairs it, not even of the lost record.
    for i in 0..40 {
        block_on(store.save(i % 3, &[i; 40])).unwrap();
        let (again, found, _) = load(store.into_flash(), &at_rest);
        assert_eq!(found, Found::Damaged, "after {i}");
        store = again;
    }
    let new = Records::from([(1, b"new".to_vec())]);
    rewrite(&mut store, &new).unwrap();
    let (store, found, records) = load(store.into_flash(), &at_rest);
    assert_eq!((found, records), (Found::Whole, new));
    let mock = store.into_flash();
    assert!(mock.erases >= 5, "moves, and both sectors");
    assert!(mock.words.iter().filter(|&&word| word != EMPTY).count() <= 4, "nothing earlier is left");
}

/// A memory with five records, of which only the mark of their sector can be read.
pub fn unreadable(at_rest: &AtRest) -> Mock<'_> {
    at_rest.set(true);
    let (mut store, ..) = load(Mock::new(at_rest), at_rest);
    for key in 0..5 {
        block_on(store.save(key, &[key; 40])).unwrap();
    }
    let mut mock = store.into_flash();
    let used = mock.words.iter().rposition(|&word| word != EMPTY).unwrap();
    mock.words[1..=used].fill(Word::Torn);
    Mock { done: 0, ..mock }
}

#[test]
fn unreadable_records_stay_damage_whatever_is_saved_and_wherever_the_power_fails() {
    let at_rest = AtRest::new();
    let whole = unreadable(&at_rest);
    // In either sector, and with foreign data in the other one.
    for (second, foreign) in [(false, false), (true, false), (false, true), (true, true)] {
        let mut mock = whole.clone();
        if foreign {
            mock.words[SECTOR / WORD..].fill(Word::Holds([0x5A; WORD]));
        }
        if second {
            mock.words.rotate_left(SECTOR / WORD);
        }
        let save_all = |left, seed| {
            let mock = Mock { left, rng: Rng::with_seed(seed), ..mock.clone() };
            let (mut store, found, _) = load(mock, &at_rest);
            assert_eq!(found, Found::Damaged);
            let saved = changes(20).iter().all(|(key, record)| block_on(store.save(*key, record)).is_ok());
            (saved, Mock { left: None, ..store.into_flash() })
        };
        let (saved, last) = save_all(None, 0);
        assert!(saved && last.erases >= 3, "{} erases", last.erases);
        for (cut, seed) in (1..=last.done).flat_map(|cut| (0..4).map(move |seed| (cut, seed))) {
            let (_, cut_short) = save_all(Some(cut), seed);
            let (mut store, found, _) = load(cut_short, &at_rest);
            assert_eq!(
                found,
                Found::Damaged,
                "second {second}, foreign {foreign}, cut at {cut}, seed {seed}"
            );
            // A rewrite is what ends it.
            let new = Records::from([(1, b"new".to_vec())]);
            rewrite(&mut store, &new).unwrap();
            assert_eq!(load(store.into_flash(), &at_rest).1, Found::Whole);
        }
    }
}

#[test]
fn after_a_power_cut_during_a_rewrite_all_old_records_apply_or_all_new_ones() {
    let at_rest = AtRest::new();
    at_rest.set(true);
    let of = |first: u8| -> Records { (0..4).map(|key| (key, std::vec![first + key; 40])).collect() };
    let new = of(100);
    for (damaged, filled) in [(false, 4), (true, 4), (false, 13), (true, 13)] {
        // With 13 records a move has taken place, so that the other sector is in use.
        let (mut store, _, _) = load(Mock::new(&at_rest), &at_rest);
        for i in 0..filled {
            block_on(store.save(i % 4, &[i; 40])).unwrap();
        }
        let mut mock = store.into_flash();
        if damaged {
            let damages = |word: &usize| {
                let mut mock = mock.clone();
                mock.words[*word] = Word::Torn;
                load(mock, &at_rest).1 == Found::Damaged
            };
            let word = (0..mock.words.len()).find(damages).unwrap();
            mock.words[word] = Word::Torn;
        }
        mock.done = 0;
        let (_, found, before) = load(mock.clone(), &at_rest);
        assert_eq!(found == Found::Damaged, damaged);
        let (mut store, _, _) = load(mock.clone(), &at_rest);
        rewrite(&mut store, &new).unwrap();
        let done = store.into_flash().done;
        assert!(done > 10, "{done}");
        let mut all_new = 0;
        for (cut, seed) in (1..=done).flat_map(|cut| (0..8).map(move |seed| (cut, seed))) {
            let cut_short = Mock { left: Some(cut), rng: Rng::with_seed(seed), ..mock.clone() };
            let (mut store, _, _) = load(cut_short, &at_rest);
            let result = rewrite(&mut store, &new);
            let mock = Mock { left: None, ..store.into_flash() };
            let (mut store, found, records) = load(mock, &at_rest);
            let case = std::format!("damaged {damaged}, cut at {cut} of {done}, seed {seed}: {result:?}");
            if records == new {
                assert_eq!(found, Found::Whole, "{case}");
                all_new += 1;
            } else {
                let expected = if damaged { Found::Damaged } else { Found::Whole };
                assert_eq!((found, &records), (expected, &before), "{case}");
            }
            // And it continues.
            rewrite(&mut store, &of(50)).unwrap();
            let (_, found, records) = load(store.into_flash(), &at_rest);
            assert_eq!((found, records), (Found::Whole, of(50)), "{case}");
        }
        assert!(all_new > 4, "{all_new}");
    }
}

#[test]
fn a_confirmation_that_is_cut_short_leaves_the_damage() {
    let at_rest = AtRest::new();
    let mock = unreadable(&at_rest);
    let new: Records = (0..4).map(|key| (key, std::vec![100 + key; 40])).collect();
    let (mut store, ..) = load(mock.clone(), &at_rest);
    rewrite(&mut store, &new).unwrap();
    let done = store.into_flash().done;
    let mut whole = 0;
    for (cut, seed) in (1..=done).flat_map(|cut| (0..8).map(move |seed| (cut, seed))) {
        let cut_short = Mock { left: Some(cut), rng: Rng::with_seed(seed), ..mock.clone() };
        let (mut store, ..) = load(cut_short, &at_rest);
        let _ = rewrite(&mut store, &new);
        let mock = Mock { left: None, ..store.into_flash() };
        let (mut store, found, records) = load(mock, &at_rest);
        let case = std::format!("cut at {cut} of {done}, seed {seed}");
        assert_eq!(found == Found::Whole, records == new, "{case}: {found:?} {:?}", records.keys());
        whole += usize::from(found == Found::Whole);
        // What is saved later does not end it.
        block_on(store.save(0, b"later")).unwrap();
        let (mut store, again, _) = load(store.into_flash(), &at_rest);
        assert_eq!(again, found, "{case}");
        // Another confirmation does.
        rewrite(&mut store, &new).unwrap();
        let (_, found, records) = load(store.into_flash(), &at_rest);
        assert_eq!((found, records), (Found::Whole, new.clone()), "{case}");
    }
    assert!(whole > 4, "{whole}");
}

/// Foreign data, among which a record cannot be written.
#[test]
fn a_power_cut_in_the_first_rewrite_of_a_memory_is_no_damage() {
    let at_rest = AtRest::new();
    at_rest.set(true);
    let mut mock = Mock::new(&at_rest);
    mock.words.fill(Word::Holds([0x5A; WORD]));
    let new: Records = (0..4).map(|key| (key, std::vec![100 + key; 40])).collect();
    let (mut store, ..) = load(mock.clone(), &at_rest);
    rewrite(&mut store, &new).unwrap();
    let done = store.into_flash().done;
    // After the erase, which may leave anything.
    for (cut, seed) in (2..=done).flat_map(|cut| (0..8).map(move |seed| (cut, seed))) {
        let cut_short = Mock { left: Some(cut), rng: Rng::with_seed(seed), ..mock.clone() };
        let (mut store, found, _) = load(cut_short, &at_rest);
        assert_eq!(found, Found::Empty);
        let _ = rewrite(&mut store, &new);
        let (_, found, records) = load(Mock { left: None, ..store.into_flash() }, &at_rest);
        let expected = if records.is_empty() { Found::Empty } else { Found::Whole };
        assert_eq!(found, expected, "cut at {cut} of {done}, seed {seed}");
    }
}

/// A memory with a record of each of these keys, in this order, stored by an image with space for them.
fn of_keys<'a>(at_rest: &'a AtRest, keys: &[u8]) -> Mock<'a> {
    let (mut store, _): (Store<'_, Mock<'_>, 32>, _) =
        block_on(Store::load(Mock::new(at_rest), at_rest, &mut |_, _| ()));
    for (i, key) in keys.iter().enumerate() {
        block_on(store.save(*key, &[*key, i as u8])).unwrap();
    }
    store.into_flash()
}

#[test]
fn records_of_a_larger_image_are_neither_damage_nor_lost() {
    let at_rest = AtRest::new();
    at_rest.set(true);
    // The node, six engines with a receiver each, and signing. A change of the node's settings may follow.
    let keys = [0, 1, 2, 3, 4, 5, 6, 0x81, 0x82, 0x83, 0x84, 0x85, 0x86, 0x80, 0];
    for count in 1..=keys.len() {
        let (mut store, found, before) = load(of_keys(&at_rest, &keys[..count]), &at_rest);
        assert_eq!((found, before.len()), (Found::Whole, count.min(keys.len() - 1)));
        // More than a sector of changes: the others move with it.
        for i in 0..60 {
            block_on(store.save(0, &[i; 2])).unwrap();
        }
        let (_, found, mut records) = load(store.into_flash(), &at_rest);
        records.insert(0, before[&0].clone());
        assert_eq!((found, records), (Found::Whole, before));
    }
    // An image with space for four of them: not those without the others.
    for count in 4..=6 {
        let mock = of_keys(&at_rest, &[1, 2, 3, 4, 5, 1][..count]);
        let (_, found): (Store<'_, Mock<'_>, 4>, _) = block_on(Store::load(mock, &at_rest, &mut |_, _| ()));
        assert_eq!(found, if count > 4 { Found::Damaged } else { Found::Whole }, "{count} records");
    }
}

#[test]
fn an_erase_that_was_refused_is_made_up_for_before_the_next_move() {
    let at_rest = AtRest::new();
    at_rest.set(true);
    let mock = Mock::new(&at_rest);
    let refuses = mock.refuses_erase.clone();
    refuses.set(true);
    let (mut store, _, _) = load(mock, &at_rest);
    let changes = changes(60);
    // From the first move on nothing is accepted, and nothing is lost.
    let taken = changes.iter().take_while(|(key, record)| block_on(store.save(*key, record)).is_ok()).count();
    assert!((5..changes.len()).contains(&taken), "{taken}");
    let (mut store, found, records) = load(store.into_flash(), &at_rest);
    assert_eq!((found, records), (Found::Whole, changes[..taken].iter().cloned().collect()));
    refuses.set(false);
    for (key, record) in &changes[taken..] {
        assert_eq!(block_on(store.save(*key, record)), Ok(()));
    }
    let (_, found, records) = load(store.into_flash(), &at_rest);
    assert_eq!((found, records), (Found::Whole, changes.into_iter().collect()));
}

#[test]
fn a_memory_whose_writes_fail_silently_is_detected() {
    let at_rest = AtRest::new();
    at_rest.set(true);
    let (mut store, _, _) = load(Mock::new(&at_rest), &at_rest);
    let mut expected = Records::new();
    for (key, record) in changes(5) {
        block_on(store.save(key, &record)).unwrap();
        expected.insert(key, record);
    }
    let good = store.into_flash();
    assert_eq!(good.erases, 0);
    let (mut store, _, _) = load(Mock { takes_no_write: true, ..good.clone() }, &at_rest);
    assert_eq!(block_on(store.save(0, b"new")), Err(NotSaved::Failed));
    let (_, found, records) = load(store.into_flash(), &at_rest);
    assert_eq!((found, &records), (Found::Whole, &expected));
    // The other sector contains foreign data, which stays there: nothing is written over it.
    let mut mock = Mock { takes_no_erase: true, ..good };
    mock.words[SECTOR / WORD..].fill(Word::Holds([0x5A; WORD]));
    let (mut store, _, _) = load(mock, &at_rest);
    let mut failed = 0;
    for (key, record) in changes(40) {
        match block_on(store.save(key, &record)) {
            Ok(()) => drop(expected.insert(key, record)),
            Err(why) => {
                assert_eq!(why, NotSaved::Failed);
                failed += 1;
            }
        }
    }
    assert!(failed > 10, "{failed}");
    let (_, found, records) = load(store.into_flash(), &at_rest);
    assert_eq!((found, records), (Found::Whole, expected));
}

/// The parameters of an engine.
fn rows(config: &EngineConfig) -> Vec<&'static Row> {
    let mut rows = Vec::new();
    find_row(Table::Engine(config), &mut |row| {
        rows.push(row);
        false
    });
    rows
}

#[test]
fn settings_go_into_a_record_and_come_back() {
    let amt = EngineConfig::amt("amt", 0, Line::new(9600), None);
    let zk = EngineConfig::zk("zk", 1, Line::new(9600), Rate::Hz20);
    for default in [amt, zk] {
        let (mut config, mut settings) = (default, EngineSettings::DEFAULT);
        for row in rows(&default) {
            let value = if row.max > row.min + 1 { row.max - 1 } else { row.max };
            if row.name != "MAV_THR_MIN" && !settings.set_own::<false>(row.name, value) {
                let mut new = config;
                if new.change_parameter(row.name, value) && validate(&[new]).is_ok() {
                    config = new;
                }
            }
        }
        let record = record::of_engine(&config, &settings, None, None);
        assert_eq!(record.len(), 1 + 6 * rows(&default).len(), "all fit");
        let (mut found, mut own) = (default, EngineSettings::DEFAULT);
        assert_eq!(record::apply_to_engine(&mut found, &mut own, &record), None);
        assert_eq!((found, own), (config, settings));
        assert_ne!((found, own), (default, EngineSettings::DEFAULT));
        // No two names have the same digest.
        let rows = rows(&default);
        let mut hashes: Vec<_> = rows.iter().map(|row| record::hash(row.name)).collect();
        hashes.sort_unstable();
        hashes.dedup();
        assert_eq!(hashes.len(), rows.len());
    }
    // A record of another ECU, a torn one, or one with values that are out of range changes nothing.
    let of_zk = record::of_engine(&zk, &EngineSettings { output: 9, ..EngineSettings::DEFAULT }, None, None);
    let mut out_of_range = record::of_engine(&amt, &EngineSettings::DEFAULT, None, None);
    out_of_range.chunks_mut(6).for_each(|entry| entry.iter_mut().skip(3).for_each(|byte| *byte = 0x7F));
    for record in [&of_zk[..], &[], &[1, 2, 3], &out_of_range] {
        let (mut found, mut own) = (amt, EngineSettings::DEFAULT);
        assert_eq!(record::apply_to_engine(&mut found, &mut own, record), None);
        assert_eq!((found, own), (amt, EngineSettings::DEFAULT));
    }
    let mut node = NodeSettings::DEFAULT;
    assert!(node.set("MAV_GCS_2", 77));
    let mut found = NodeSettings::DEFAULT;
    record::apply_to_node(&mut found, &mut [], &record::of_node(&node, None, &[], &[]));
    assert_eq!(found, node);
}

#[test]
fn a_setting_is_answered_when_it_is_stored_and_is_as_before_if_it_cannot_be() {
    run(async |world| {
        world.ready().await;
        world.service.borrow_mut().set_parameter_storage(ParameterStorage::Stored);
        for (result, value, why) in [
            (Ok(()), 2500, ""),
            (Err(NotSaved::Full), 2500, "LOSS_HOLD not set: the storage is full"),
            (Err(NotSaved::Failed), 2500, "LOSS_HOLD not set: it cannot be stored"),
        ] {
            let new = if result.is_ok() { 2500.0 } else { 3000.0 };
            // Nothing is answered before it is stored.
            assert_eq!(world.set(ENGINE[1], "LOSS_HOLD", new).await, (None, String::new()));
            let (key, record) = world.service.borrow_mut().next_save().unwrap();
            assert_eq!(key, 2);
            let mut stored = *world.service.borrow().engine_settings().nth(1).unwrap().0;
            record::apply_to_engine(&mut stored, &mut EngineSettings::DEFAULT.clone(), &record);
            assert_eq!(stored.number("LOSS_HOLD"), Some(new as i32));
            let at = world.frames.borrow().len();
            world.service.borrow_mut().saved(Instant::now(), result);
            world.pass_s(0.2).await;
            let (echo, text) = world.answers(at);
            assert_eq!(echo, Some(value as f32));
            assert!(text.contains(why), "{text}");
            let service = world.service.borrow();
            assert_eq!(service.engine_settings().nth(1).unwrap().0.number("LOSS_HOLD"), Some(value));
            assert!(service.is_saved());
        }
        world.service.borrow_mut().set_parameter_storage(ParameterStorage::Lost);
        let (echo, text) = world.set(NODE, "MAV_GCS_2", 9.0).await;
        assert!(echo == Some(9.0) && text.contains("is not stored"), "{text}");
        // At rest, and not at rest.
        assert!(world.service.borrow().is_at_rest());
        world.start(1).await;
        assert!(!world.service.borrow().is_at_rest());
    });
}
