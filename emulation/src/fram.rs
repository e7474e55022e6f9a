//! An F-RAM on SPI, from its data sheet (FM25V01A, Cypress, 128 kbit: commands, status register, identification), in the
//! place where a board has one.
//!
//! Left out: FSTRD and SLEEP, which the firmware does not use, the pins WP and HOLD, the time after power-up.

use rigless::chip::Timeline;
use rigless::chip::spi::Peer;
use rigless::snapshot::Store;

const WRSR: u8 = 0x01;
const WRITE: u8 = 0x02;
const READ: u8 = 0x03;
const WRDI: u8 = 0x04;
const RDSR: u8 = 0x05;
const WREN: u8 = 0x06;
const RDID: u8 = 0x9F;

/// Writes are enabled.
const WEL: u8 = 1 << 1;
/// Blocks are protected: the upper quarter, the upper half, all.
const BP: u8 = 0b11 << 2;
/// Bits that a WRSR changes: the protection, and WPEN.
const WRITABLE: u8 = 1 << 7 | BP;

/// The chip. Its memory survives a reset of the board and a loss of the supply.
#[derive(Clone, Debug)]
pub struct Fram {
    id: [u8; 9],
    /// Bytes of an address.
    address: usize,
    memory: Vec<u8>,
    status: u8,
    /// Bytes since it was selected.
    command: Vec<u8>,
    /// Number of bytes that were written.
    pub written: usize,
    /// Number of unknown commands, and of writes that were not enabled or are protected.
    pub ignored: Vec<u8>,
}

impl Fram {
    /// An FM25V01A: 16 KiB, two bytes of an address. It is erased.
    pub fn fm25v01a() -> Self {
        Self::new([0x21, 0x08], 16, 2)
    }

    /// An FM25V20A: 256 KiB, three bytes of an address. It is erased.
    pub fn fm25v20a() -> Self {
        Self::new([0x25, 0x08], 256, 3)
    }

    fn new([family, revision]: [u8; 2], kib: usize, address: usize) -> Self {
        Self {
            id: [0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0xC2, family, revision],
            address,
            memory: vec![0xFF; kib * 1024],
            status: 0,
            command: Vec::new(),
            written: 0,
            ignored: Vec::new(),
        }
    }

    /// The same chip with another identification.
    pub fn with_id(self, id: [u8; 9]) -> Self {
        Self { id, ..self }
    }

    /// The same chip with foreign data.
    pub fn used(mut self) -> Self {
        self.memory.iter_mut().enumerate().for_each(|(at, byte)| *byte = (at * 7 + at / 256) as u8);
        self
    }

    /// The same chip with these bytes from its beginning on.
    pub fn holding(mut self, bytes: &[u8]) -> Self {
        self.memory[..bytes.len()].copy_from_slice(bytes);
        self
    }

    /// The same chip with all blocks protected.
    pub fn protected(self) -> Self {
        Self { status: BP, ..self }
    }

    /// The chip after its supply was off: writes are not enabled.
    pub fn powered_up(self) -> Self {
        Self { status: self.status & !WEL, command: Vec::new(), ..self }
    }

    /// Whether the memory of both is the same.
    pub fn holds_the_same(&self, other: &Self) -> bool {
        self.memory == other.memory
    }

    fn is_protected(&self, at: usize) -> bool {
        let size = self.memory.len();
        let from = match (self.status & BP) >> 2 {
            0 => size,
            1 => size / 4 * 3,
            2 => size / 2,
            _ => 0,
        };
        at >= from
    }

    /// The byte that answers the one that comes in at the same time.
    fn byte(&mut self, byte: u8) -> u8 {
        self.command.push(byte);
        let Some((&command, rest)) = self.command.split_first() else { return 0 };
        let data = rest.len().checked_sub(self.address + 1);
        let address = rest.iter().take(self.address).fold(0, |at, &byte| at << 8 | usize::from(byte));
        let at = data.map(|data| (address + data) % self.memory.len());
        match (command, rest.len(), at) {
            (RDID, at @ 1.., _) => self.id.get(at - 1).copied().unwrap_or(0),
            (RDSR, 1.., _) => self.status,
            (READ, _, Some(at)) => self.memory[at],
            (WRITE, _, Some(at)) if self.status & WEL != 0 && !self.is_protected(at) => {
                self.memory[at] = byte;
                self.written += 1;
                0
            }
            (WRSR, 1, _) if self.status & WEL != 0 => {
                self.status = self.status & !WRITABLE | byte & WRITABLE;
                0
            }
            (WRITE, _, Some(_)) | (WRSR, 1, _) => {
                self.ignored.push(command);
                0
            }
            (RDID | RDSR | READ | WRITE | WRSR | WREN | WRDI, ..) => 0,
            _ => {
                self.ignored.push(command);
                0
            }
        }
    }
}

impl Store for Fram {} // no snapshots

impl Peer for Fram {
    fn transfer(&mut self, mosi: u32, _: u8, _: &mut Timeline<'_, '_>) -> u32 {
        self.byte(mosi as u8).into()
    }

    fn select(&mut self, _: &mut Timeline<'_, '_>) {
        self.command.clear();
    }

    fn deselect(&mut self, _: &mut Timeline<'_, '_>) {
        match self.command.first() {
            Some(&WREN) => self.status |= WEL,
            Some(&(WRDI | WRSR | WRITE)) => self.status &= !WEL,
            _ => {}
        }
        self.command.clear();
    }
}
