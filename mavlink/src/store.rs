//! Stored settings: a record for each component, appended to a flash memory. They survive a power cut at any moment.
//!
//! The map itself is the crate `sequential-storage`. This module adds three things:
//!
//! - **No erase in flight.** An erase stalls a core that reads the same memory. The crate erases within a save and in its
//!   repairs, so `Guard` refuses every erase unless [`AtRest`] is set. In flight, a record that would need an erase is refused
//!   before anything is written.
//! - **A word torn by a power cut** may be unreadable: two wrong bits in a word of an STM32H7's flash cause an error at each read. Such
//!   a word counts as written and wrong.
//! - **Empty and damaged differ.** Each record has a sequence number and the digest of all newest records, so that a lost
//!   newest record is noticed ([`Found::Damaged`]), but not a record that a power cut kept from being written. A lost record
//!   stays noticed until everything is rewritten: the digest of each later one is wrong as well.
//!
//! There are two sectors. Whenever the power fails, one of them alone has all newest records: a migration erases the old
//! sector only after it has copied everything. So each sector is examined alone, and before the next save the other one is
//! erased if it is not empty: the crate's own repair could erase the good one.

use core::cmp::Ordering;
use core::fmt::Debug;
use core::sync::atomic::{self, AtomicBool};
use embassy_futures::yield_now;
use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use heapless::Vec;
use jetlink::checksum::Checksum;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage, SerializationError, Value};

/// Size of the largest record, bytes.
pub const RECORD: usize = 256;
/// Largest number of records: of the node, of six engines, of what is attached to each, and of signing. An image stores fewer of them, but may
/// find those of another one.
pub const KEYS: usize = 14;
/// Sequence number and digest, in front of each record.
const HEAD: usize = 8;
/// A record with its key and head, rounded up to the largest word of a flash memory.
const BUFFER: usize = (1 + HEAD + RECORD).next_multiple_of(32);
/// The mark in front, its head, and the first record: the most that a power cut leaves if nothing has been stored.
const FIRST: u32 = (2 * WORD + BUFFER) as u32;
/// Number of reads until other tasks may run.
const TURN: u8 = 32;
/// Largest word of a flash memory, bytes.
const WORD: usize = 32;

/// Whether all engines are known to be at rest.
#[derive(Debug, Default)]
pub struct AtRest(AtomicBool);

impl AtRest {
    /// Unknown at first.
    pub const fn new() -> Self {
        Self(AtomicBool::new(false))
    }

    /// Sets it.
    pub fn set(&self, at_rest: bool) {
        self.0.store(at_rest, atomic::Ordering::Relaxed);
    }

    /// Whether they are.
    pub fn get(&self) -> bool {
        self.0.load(atomic::Ordering::Relaxed)
    }
}

/// Result of the search at the start.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Found {
    /// Nothing of ours: the settings are the defaults.
    Empty,
    /// All records.
    Whole,
    /// Records are missing.
    Damaged,
}

/// Why a record was not saved.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum NotSaved {
    /// There is no space without an erase, and an engine may turn.
    Full,
    /// The memory does not accept it.
    Failed,
}

impl core::fmt::Display for NotSaved {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Full => "no space without an erase: stop the engines first",
            Self::Failed => "the memory does not take it",
        })
    }
}

impl core::error::Error for NotSaved {}

/// A flash memory for [`Store`]: two sectors from offset 0 on.
///
/// A read may fail at an unreadable word; then none of its bytes are used.
pub trait Flash: NorFlash + Debug {}

/// Refuses erases while engines may turn, and writes to words that are not empty. Reads unreadable words as zeros.
#[derive(Debug)]
struct Guard<'a, F> {
    flash: F,
    at_rest: &'a AtRest,
    /// The numbers of the sectors are swapped.
    swapped: bool,
    /// The other sector reads as empty.
    only: Option<u32>,
    /// Number of reads since other tasks could run.
    reads: u8,
    /// A read has succeeded.
    readable: bool,
}

/// What [`Guard`] reports.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct GuardError;

impl NorFlashError for GuardError {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl<F: Flash> Guard<'_, F> {
    /// Its place in the memory.
    const fn place(&self, at: u32) -> u32 {
        const { assert!(F::ERASE_SIZE.is_power_of_two()) };
        if self.swapped { at ^ F::ERASE_SIZE as u32 } else { at }
    }
}

impl<F: Flash> ErrorType for Guard<'_, F> {
    type Error = GuardError;
}

impl<F: Flash> ReadNorFlash for Guard<'_, F> {
    const READ_SIZE: usize = F::READ_SIZE;

    async fn read(&mut self, at: u32, bytes: &mut [u8]) -> Result<(), GuardError> {
        // A read never waits, and a migration takes some 100 000 of them: other tasks may run in between.
        self.reads += 1;
        if self.reads == TURN {
            self.reads = 0;
            yield_now().await;
        }
        if self.only.is_some_and(|only| at / Self::ERASE_SIZE as u32 != only) {
            bytes.fill(0xFF);
        } else if self.flash.read(self.place(at), bytes).await.is_err() {
            bytes.fill(0);
        } else {
            self.readable = true;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl<F: Flash> NorFlash for Guard<'_, F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), GuardError> {
        if !self.at_rest.get() {
            return Err(GuardError);
        }
        // One sector at a time.
        let length = to - from;
        let from = self.place(from);
        self.flash.erase(from, from + length).await.map_err(|_| GuardError)
    }

    async fn write(&mut self, at: u32, bytes: &[u8]) -> Result<(), GuardError> {
        const { assert!(F::WRITE_SIZE <= WORD) };
        let mut address = at;
        for word in bytes.chunks(F::WRITE_SIZE) {
            let mut found = [0; WORD];
            let found = found.get_mut(..word.len()).ok_or(GuardError)?;
            self.read(address, found).await?;
            if found.iter().any(|&byte| byte != 0xFF) {
                return Err(GuardError);
            }
            self.flash.write(self.place(address), word).await.map_err(|_| GuardError)?;
            self.read(address, found).await?;
            if found != word {
                return Err(GuardError);
            }
            address = address.checked_add(F::WRITE_SIZE as u32).ok_or(GuardError)?;
        }
        Ok(())
    }
}

/// A record after its head. The map joins them as it writes them.
struct Item<'a> {
    sequence: u32,
    digest: u32,
    record: &'a [u8],
}

impl<'a> Value<'a> for Item<'a> {
    fn serialize_into(&self, buffer: &mut [u8]) -> Result<usize, SerializationError> {
        let parts = [&self.sequence.to_le_bytes()[..], &self.digest.to_le_bytes(), self.record];
        let mut left = buffer;
        for part in parts {
            let (slot, rest) =
                left.split_at_mut_checked(part.len()).ok_or(SerializationError::BufferTooSmall)?;
            slot.copy_from_slice(part);
            left = rest;
        }
        Ok(HEAD + self.record.len())
    }

    fn deserialize_from(buffer: &'a [u8]) -> Result<(Self, usize), SerializationError> {
        let (&[s0, s1, s2, s3, d0, d1, d2, d3], record) =
            buffer.split_first_chunk().ok_or(SerializationError::InvalidData)?;
        let (sequence, digest) = (u32::from_le_bytes([s0, s1, s2, s3]), u32::from_le_bytes([d0, d1, d2, d3]));
        Ok((Self { sequence, digest, record }, buffer.len()))
    }
}

type Map<'a, F> = MapStorage<u8, Guard<'a, F>, Cache<Uncached, Uncached, Uncached, u8>>;

/// One newest record. Packed: three lists of them are in RAM.
#[derive(Clone, Copy, Debug)]
#[repr(C, packed)]
struct Newest {
    key: u8,
    sequence: u32,
    own: u32,
}

/// The newest records of a sector.
#[derive(Clone, Default, Debug)]
struct Chain<const KEYS: usize> {
    newest: Vec<Newest, KEYS>,
    /// Sequence number of the last record.
    sequence: u32,
    /// The digest in the last record, from which that of the next one follows. Where records are missing it is wrong, and stays so.
    digest: u32,
}

impl<const KEYS: usize> Chain<KEYS> {
    /// Takes a record.
    fn take(&mut self, found: Newest, digest: u32) {
        if found.sequence >= self.sequence {
            (self.sequence, self.digest) = (found.sequence, digest);
        }
        match self.newest.iter_mut().find(|newest| newest.key == found.key) {
            Some(newest) if newest.sequence <= found.sequence => *newest = found,
            Some(_) => {}
            // If there are too many, their digest does not match.
            None => drop(self.newest.push(found)),
        }
    }

    /// Whether none is missing. The records of a rewrite have no sequence number but for the last one: without that they are not whole.
    fn is_whole(&self) -> bool {
        self.sequence > 0 && self.digest == self.sum()
    }

    /// Digest of all newest records.
    fn sum(&self) -> u32 {
        self.newest.iter().fold(0, |digest, newest| digest ^ newest.own)
    }

    /// Whether records are missing, and no other one is there.
    fn all_are_missing(&self) -> bool {
        self.newest.is_empty() && self.digest != 0
    }
}

/// Records by key: 0 is the node, the others are engines and attached devices. `KEYS` is the largest number of them, including those
/// stored by another image.
pub struct Store<'a, F: Flash, const KEYS: usize = { self::KEYS }> {
    map: Map<'a, F>,
    at_rest: &'a AtRest,
    chain: Chain<KEYS>,
    /// All records are being rewritten, and this is not the last one yet.
    rewriting: bool,
    /// The sector that has all newest records.
    sector: u32,
    /// Empty space; `None` until it is needed, as reading all of a slow memory delays a start.
    space: Option<Space>,
}

/// Empty space in the two sectors.
#[derive(Clone, Copy, Debug)]
struct Space {
    /// Empty bytes at the end of the sector that has all newest records.
    free: u32,
    /// The other sector is not empty.
    dirty: bool,
}

impl<F: Flash, const KEYS: usize> Debug for Store<'_, F, KEYS> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Store").field("chain", &self.chain).finish_non_exhaustive()
    }
}

impl<'a, F: Flash, const KEYS: usize> Store<'a, F, KEYS> {
    const SECTOR: u32 = F::ERASE_SIZE as u32;
    const CONFIG: MapConfig<Guard<'a, F>> = MapConfig::new(0..2 * Self::SECTOR);

    /// Reads the memory; `each` gets the newest record of each key, the node's first: an engine's wiring decides whether its own record
    /// applies. Nothing is written or erased.
    pub async fn load(flash: F, at_rest: &'a AtRest, each: &mut dyn FnMut(u8, &[u8])) -> (Self, Found) {
        let guard = Guard { flash, at_rest, swapped: false, only: None, reads: 0, readable: false };
        let map = MapStorage::new(guard, Self::CONFIG, Cache::new_uncached());
        let mut store =
            Self { map, at_rest, chain: Chain::default(), rewriting: false, sector: 0, space: None };
        let found = store.survey().await;
        let newest = store.chain.newest.clone();
        if newest.is_empty() {
            return (store, found);
        }
        for of_node in [true, false] {
            store
                .scan(store.sector, &mut |found, _, record| {
                    let own = newest.iter().find(|newest| newest.key == found.key);
                    if (found.key == 0) == of_node && own.is_some_and(|own| own.sequence == found.sequence) {
                        each(found.key, record);
                    }
                })
                .await;
        }
        (store, found)
    }

    /// Finds the sector that has all newest records, and what is wrong with it.
    async fn survey(&mut self) -> Found {
        let mut sectors: [Chain<KEYS>; 2] = Default::default();
        for (sector, chain) in (0..).zip(&mut sectors) {
            self.scan(sector, &mut |found, digest, _| chain.take(found, digest)).await;
        }
        let rank = |chain: &Chain<KEYS>| (!chain.newest.is_empty(), chain.sequence, chain.is_whole());
        let [first, second] = &sectors;
        let second_is_it = match rank(second).cmp(&rank(first)) {
            Ordering::Less => false,
            Ordering::Greater => true,
            Ordering::Equal if first.newest.is_empty() => false,
            // If both have all, the less full one is the copy, and the other one may be half erased.
            Ordering::Equal => self.empty_at_end(1).await > self.empty_at_end(0).await,
        };
        self.sector = second_is_it.into();
        self.space = None;
        self.rewriting = false;
        self.chain = (if second_is_it { second } else { first }).clone();
        if self.chain.is_whole() {
            return Found::Whole;
        }
        // Our data may be unreadable: nothing can be read, or the sector begins with the mark, is not all zeros, and holds more than a first record,
        // which a power cut may have torn.
        let mut ours = !self.chain.newest.is_empty() || !self.map.flash().readable;
        for sector in 0..2 {
            let mut mark = [0; WORD];
            // An unreadable word reads as the mark.
            if !ours
                && self.map.flash().read(sector * Self::SECTOR, &mut mark).await.is_ok()
                && mark.iter().all(|&byte| byte == 0)
            {
                ours = (1..Self::SECTOR.saturating_sub(FIRST)).contains(&self.empty_at_end(sector).await);
                self.sector = if ours { sector } else { 0 };
            }
        }
        if !ours {
            return Found::Empty;
        }
        if self.chain.digest == self.chain.sum() {
            // All are unreadable, or the last one of a rewrite is missing.
            self.chain.digest = !self.chain.digest;
        }
        Found::Damaged
    }

    /// The empty space.
    async fn space(&mut self) -> Space {
        if let Some(space) = self.space {
            return space;
        }
        let [first, second] = [self.empty_at_end(0).await, self.empty_at_end(1).await];
        if self.chain.newest.is_empty() && self.chain.digest == 0 {
            self.sector = (second > first).into();
        }
        let [free, other] = if self.sector == 1 { [second, first] } else { [first, second] };
        *self.space.insert(Space { free, dirty: other < Self::SECTOR })
    }

    /// Empty bytes at the end of a sector, in whole words, without the mark that closes it.
    async fn empty_at_end(&mut self, sector: u32) -> u32 {
        const { assert!(F::ERASE_SIZE.is_multiple_of(WORD) && WORD.is_multiple_of(F::WRITE_SIZE)) };
        let mut empty = 0;
        while empty < Self::SECTOR {
            let mut bytes = [0; WORD];
            let at = (sector + 1) * Self::SECTOR - empty - WORD as u32;
            // Unreadable words read as 0.
            let read = self.map.flash().read(at, &mut bytes).await;
            let last =
                if read.is_err() { Some(WORD - 1) } else { bytes.iter().rposition(|&byte| byte != 0xFF) };
            let Some(last) = last else {
                empty += WORD as u32;
                continue;
            };
            let behind = WORD - 1 - last;
            return empty + (behind - behind % F::WRITE_SIZE) as u32;
        }
        empty
    }

    /// Passes every record of a sector to `each`, also the older ones of a key, with the digest of all.
    async fn scan(&mut self, sector: u32, each: &mut dyn FnMut(Newest, u32, &[u8])) {
        self.map.flash().only = Some(sector);
        let mut buffer = [0; BUFFER];
        if let Ok(mut records) = self.map.fetch_all_items(&mut buffer).await {
            while let Ok(Some((key, bytes))) = records.next::<&[u8]>(&mut buffer).await {
                // Data that is too short is foreign.
                let Ok((Item { sequence, digest, record }, _)) = Item::deserialize_from(bytes) else {
                    continue;
                };
                each(Newest { key, sequence, own: own_digest(key, record) }, digest, record);
            }
        }
        self.map.flash().only = None;
    }

    /// Saves a record. It is not written again if it already is the newest of its key.
    ///
    /// # Errors
    /// [`NotSaved`]: the newest record of this key is as before.
    pub async fn save(&mut self, key: u8, record: &[u8]) -> Result<(), NotSaved> {
        let Space { free, dirty } = self.space().await;
        let at_rest = self.at_rest.get();
        let cleaned = if dirty && at_rest { self.clean().await } else { Ok(()) };
        let own = own_digest(key, record);
        let before = self.chain.newest.iter().find(|newest| newest.key == key).map(|newest| newest.own);
        if before == Some(own) {
            return Ok(());
        }
        cleaned?;
        // From the last one's digest: a record missing now is also missing with this record.
        let digest = self.chain.digest ^ before.unwrap_or(0) ^ own;
        // What shows that all were lost stays until this one is stored.
        let turns = self.chain.all_are_missing();
        let free = if turns { Self::SECTOR } else { free };
        let sequence = if self.rewriting { 0 } else { self.chain.sequence.wrapping_add(1) };
        let length = HEAD + record.len();
        if record.len() > RECORD || before.is_none() && self.chain.newest.is_full() {
            return Err(NotSaved::Failed);
        }
        // The mark that closes the sector needs space; an empty sector also gets one that opens it.
        let word = F::WRITE_SIZE as u32;
        let opening = if free == Self::SECTOR { word } else { 0 };
        let length = (1 + length as u32).next_multiple_of(word);
        let needed = opening + Map::<F>::item_overhead_size() + length;
        let fits = needed + word <= free;
        if (!fits || dirty) && !at_rest {
            return Err(NotSaved::Full);
        }
        if turns {
            self.turn();
        }
        // In a block, so that its buffer does not coexist with those of a survey.
        let stored = {
            let mut buffer = [0; BUFFER];
            self.map.store_item(&mut buffer, &key, &Item { sequence, digest, record }).await
        };
        if stored.is_ok() && fits {
            self.chain.take(Newest { key, sequence, own }, digest);
            // Also during a rewrite, where it is not the last one.
            self.chain.digest = digest;
            self.space = Some(Space { free: free.saturating_sub(needed), dirty: false });
            if !self.rewriting && self.map.flash().only.take().is_some() {
                // These records apply now, and those in the other sector no longer do.
                self.space = None;
            }
        } else {
            // After a failure, part of it may have been written.
            self.survey().await;
        }
        stored.map_err(|_| NotSaved::Failed)
    }

    /// Erases the sector that lacks some newest records.
    async fn clean(&mut self) -> Result<(), NotSaved> {
        let other = (1 - self.sector) * Self::SECTOR;
        self.map.flash().erase(other, other + Self::SECTOR).await.map_err(|_| NotSaved::Failed)?;
        self.space = self.space.map(|space| Space { dirty: false, ..space });
        Ok(())
    }

    /// Begins to rewrite all records, for a memory that accepts no more records, is damaged or has foreign data: [`Store::save`] writes them to
    /// the other sector. The previous ones apply until the last one is saved, which [`Store::end_rewrite`] announces. One more save, of any
    /// record, erases the old ones.
    ///
    /// # Errors
    /// [`NotSaved`].
    pub async fn begin_rewrite(&mut self) -> Result<(), NotSaved> {
        if !self.at_rest.get() {
            return Err(NotSaved::Full);
        }
        // Unknown, if this fails.
        self.space = None;
        self.clean().await?;
        self.turn();
        // Where there was nothing, each record applies at once.
        self.rewriting = self.chain.sequence > 0 || self.chain.digest != 0;
        self.chain.digest = 0;
        self.chain.newest.clear();
        Ok(())
    }

    /// The next record goes to the other sector, which is empty: nothing is appended, moved or erased in this one.
    fn turn(&mut self) {
        let guard = self.map.flash();
        // The crate begins in the first one.
        guard.swapped ^= self.sector == 0;
        guard.only = Some(0);
        self.sector = 0;
    }

    /// The next saved record is the last one of the rewrite.
    pub fn end_rewrite(&mut self) {
        self.rewriting = false;
    }

    /// Keys of the records, also of those of another image.
    pub fn keys(&self) -> impl Iterator<Item = u8> {
        self.chain.newest.iter().map(|newest| newest.key)
    }

    /// Gives the memory back.
    pub fn into_flash(self) -> F {
        self.map.destroy().0.flash
    }
}

fn own_digest(key: u8, record: &[u8]) -> u32 {
    Checksum::new().bytes(&[key]).bytes(record).value()
}
