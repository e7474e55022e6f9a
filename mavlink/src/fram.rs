//! F-RAM on SPI as the memory of a [`Store`](crate::store::Store): flight controllers with an FMU of version 2 to 6 keep their parameters there.
//!
//! The chip is recognised by its identification, which has two forms: 9 bytes of Cypress (Ramtron), 4 of Fujitsu. A chip that is
//! not in [`CHIPS`] is not used: no register contains the length of its addresses. An F-RAM has no sectors and needs no erase;
//! here an erase writes 0xFF, so that the same store serves both kinds of memory.
//!
//! Sources: FM25V02A data sheet (Infineon 001-90865), MB85RS256B data sheet (Fujitsu DS501-00021), and the numbers of
//! ArduPilot's `AP_RAMTRON`. **This has not run on hardware.**

use crate::store::Flash;
use embassy_futures::yield_now;
use embedded_hal::spi::{Operation, SpiDevice};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};

const WRITE_STATUS: u8 = 0x01;
const WRITE: u8 = 0x02;
const READ: u8 = 0x03;
const READ_STATUS: u8 = 0x05;
const WRITE_ENABLE: u8 = 0x06;
const READ_ID: u8 = 0x9F;

/// Bits of the status register: block protection, and its lock by the pin WP.
const PROTECTION: u8 = 0b1000_1100;
/// Bytes that are written at once: 80 µs at 4 MHz.
const CHUNK: usize = 32;
/// Half of the smallest chip.
const SECTOR: usize = 8 * 1024;

/// Manufacturer of a chip, which determines the form of its identification.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Maker {
    /// Cypress, before it Ramtron: 7F six times, C2, and two bytes of the product.
    Cypress,
    /// Fujitsu: 04 7F, and two bytes of the product.
    Fujitsu,
}

/// A known chip.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Chip {
    /// Its manufacturer.
    pub maker: Maker,
    /// The two bytes of the product.
    pub product: [u8; 2],
    /// Size, KiB.
    pub kib: u16,
    /// Bytes of an address.
    pub address: u8,
}

const fn cypress(product: [u8; 2], kib: u16, address: u8) -> Chip {
    Chip { maker: Maker::Cypress, product, kib, address }
}

const fn fujitsu(product: [u8; 2], kib: u16, address: u8) -> Chip {
    Chip { maker: Maker::Fujitsu, product, kib, address }
}

/// The known chips.
pub const CHIPS: [Chip; 14] = [
    cypress([0x21, 0x00], 16, 2),  // FM25V01
    cypress([0x21, 0x08], 16, 2),  // FM25V01A
    cypress([0x22, 0x00], 32, 2),  // FM25V02
    cypress([0x22, 0x08], 32, 2),  // FM25V02A
    cypress([0x22, 0x01], 32, 2),  // FM25VN02
    cypress([0x23, 0x00], 64, 2),  // FM25V05
    cypress([0x23, 0x01], 64, 2),  // FM25VN05
    cypress([0x24, 0x00], 128, 3), // FM25V10
    cypress([0x24, 0x01], 128, 3), // FM25VN10
    cypress([0x25, 0x08], 256, 3), // FM25V20A
    cypress([0x26, 0x08], 512, 3), // CY15B104Q
    fujitsu([0x27, 0x03], 128, 3), // MB85RS1MT
    fujitsu([0x05, 0x09], 32, 2),  // MB85RS256B
    fujitsu([0x24, 0x03], 16, 2),  // MB85RS128TY
];

/// Why a chip is not used.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum NotUsed {
    /// The bus reports an error.
    Bus,
    /// There is no chip, or an unknown one: the bytes read as its identification.
    Unknown([u8; 9]),
    /// Its protection cannot be cleared: the pin WP may lock it.
    Protected,
}

impl core::fmt::Display for NotUsed {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Bus => f.write_str("the bus reports an error"),
            Self::Unknown(id) => write!(f, "no known chip: it identifies itself as {id:02x?}"),
            Self::Protected => f.write_str("the chip is write-protected: check its pin WP"),
        }
    }
}

impl core::error::Error for NotUsed {}

impl NotUsed {
    /// Whether settings may be in it: a chip that identifies itself as another one has none, and none may be there at all.
    pub const fn may_have_settings(self) -> bool {
        matches!(self, Self::Bus | Self::Protected)
    }
}

/// Recognises the chip. A chip that has just been powered up may need some time before it answers.
///
/// # Errors
/// [`NotUsed`] if it is not known.
pub fn identify(device: &mut impl SpiDevice) -> Result<Chip, NotUsed> {
    let mut id = [0; 9];
    let mut look = [Operation::Write(&[READ_ID]), Operation::Read(&mut id)];
    device.transaction(&mut look).map_err(|_| NotUsed::Bus)?;
    let of = |chip: &Chip| match (chip.maker, id) {
        (Maker::Cypress, [0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0xC2, a, b])
        | (Maker::Fujitsu, [0x04, 0x7F, a, b, ..]) => chip.product == [a, b],
        _ => false,
    };
    CHIPS.into_iter().find(of).ok_or(NotUsed::Unknown(id))
}

/// An F-RAM.
#[derive(Debug)]
pub struct Fram<D> {
    device: D,
    address: u8,
}

impl<D: SpiDevice> Fram<D> {
    /// Recognises the chip, and clears its protection.
    ///
    /// # Errors
    /// [`NotUsed`] if it is not known, or cannot be written.
    pub fn find(mut device: D) -> Result<(Self, Chip), NotUsed> {
        let chip = identify(&mut device)?;
        let mut this = Self { device, address: chip.address };
        if this.status()? & PROTECTION != 0 {
            this.command(&[WRITE_ENABLE]).map_err(|_| NotUsed::Bus)?;
            this.command(&[WRITE_STATUS, 0]).map_err(|_| NotUsed::Bus)?;
            if this.status()? & PROTECTION != 0 {
                return Err(NotUsed::Protected);
            }
        }
        Ok((this, chip))
    }

    /// Gives the device back.
    pub fn into_device(self) -> D {
        self.device
    }

    fn status(&mut self) -> Result<u8, NotUsed> {
        let mut status = [0];
        let mut look = [Operation::Write(&[READ_STATUS]), Operation::Read(&mut status)];
        self.device.transaction(&mut look).map_err(|_| NotUsed::Bus)?;
        Ok(u8::from_le_bytes(status))
    }

    fn command(&mut self, command: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.device.write(command).map_err(|_| NorFlashErrorKind::Other)
    }

    /// A command with an address, and its length.
    const fn addressed(&self, command: u8, at: u32) -> ([u8; 4], usize) {
        let [_, high, mid, low] = at.to_be_bytes();
        if self.address == 3 { ([command, high, mid, low], 4) } else { ([command, mid, low, 0], 3) }
    }

    fn read_at(&mut self, at: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let (command, length) = self.addressed(READ, at);
        let command = command.get(..length).unwrap_or_default();
        let mut read = [Operation::Write(command), Operation::Read(bytes)];
        self.device.transaction(&mut read).map_err(|_| NorFlashErrorKind::Other)
    }

    /// Writes a chunk, and reads it back. Each write needs a WREN of its own.
    fn write_chunk(&mut self, at: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.command(&[WRITE_ENABLE])?;
        let (command, length) = self.addressed(WRITE, at);
        let command = command.get(..length).unwrap_or_default();
        let mut write = [Operation::Write(command), Operation::Write(bytes)];
        self.device.transaction(&mut write).map_err(|_| NorFlashErrorKind::Other)?;
        let mut back = [0; CHUNK];
        let back = back.get_mut(..bytes.len()).ok_or(NorFlashErrorKind::OutOfBounds)?;
        self.read_at(at, back)?;
        if back == bytes { Ok(()) } else { Err(NorFlashErrorKind::Other) }
    }
}

/// A chip would wrap to its beginning after its end.
fn within(at: u32, length: usize) -> Result<(), NorFlashErrorKind> {
    match usize::try_from(at).ok().and_then(|at| at.checked_add(length)) {
        Some(end) if end <= 2 * SECTOR => Ok(()),
        _ => Err(NorFlashErrorKind::OutOfBounds),
    }
}

impl<D> ErrorType for Fram<D> {
    type Error = NorFlashErrorKind;
}

impl<D: SpiDevice> ReadNorFlash for Fram<D> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, at: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        within(at, bytes.len())?;
        self.read_at(at, bytes)
    }

    fn capacity(&self) -> usize {
        2 * SECTOR
    }
}

impl<D: SpiDevice> NorFlash for Fram<D> {
    /// The chip itself writes bytes. A start searches each word of foreign data for a record, so words are long.
    const WRITE_SIZE: usize = CHUNK;
    const ERASE_SIZE: usize = SECTOR;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        within(from, to.saturating_sub(from) as usize)?;
        let mut at = from;
        while at < to {
            let length = CHUNK.min((to - at) as usize);
            self.write_chunk(at, [0xFF; CHUNK].get(..length).unwrap_or_default())?;
            at += length as u32;
            // The transfer blocks: let other tasks run.
            yield_now().await;
        }
        Ok(())
    }

    async fn write(&mut self, at: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        within(at, bytes.len())?;
        for (bytes, at) in bytes.chunks(CHUNK).zip((at..).step_by(CHUNK)) {
            self.write_chunk(at, bytes)?;
            yield_now().await;
        }
        Ok(())
    }
}

impl<D: SpiDevice + core::fmt::Debug> Flash for Fram<D> {}
