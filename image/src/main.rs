//! `cargo image`: builds the firmware of a board and writes the files that flash it.
//!
//! `.elf` for probe-rs, `.bin` for dfu-util, `.hex` for other programmers. For a board that keeps its ArduPilot
//! bootloader also `.apj`, with the application descriptor that some bootloaders check.

#![forbid(unsafe_code)]

use base64::Engine as _;
use boards::{Before, Board, Bootloader};
use clap::Parser;
use commands::image::Args;
use crc::{Algorithm, Crc};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

/// The first bytes of the application descriptor; src/board/ardupilot.rs has the rest of its layout.
const SIGNATURE: [u8; 8] = [0x40, 0xA2, 0xE4, 0xF1, 0x64, 0x68, 0x91, 0x06];
/// Its length, and where in it the second checksum begins.
const DESCRIPTOR_LEN: usize = 36;
const SECOND_PART: usize = 24;

/// ArduPilot's crc32_small: CRC-32 without inversion at start and end.
const CRC: Algorithm<u32> = Algorithm {
    width: 32,
    poly: 0x04C1_1DB7,
    init: 0,
    refin: true,
    refout: true,
    xorout: 0,
    check: 0x2DFD_2D88,
    residue: 0,
};

fn main() -> ExitCode {
    match build_and_write(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("{why}");
            ExitCode::FAILURE
        }
    }
}

fn build_and_write(args: &Args) -> Result<(), String> {
    let board = args.board;
    let bootloader = if args.ardupilot_bootloader {
        Some(board.bootloader.ok_or_else(|| format!("{} has no bootloader to keep", board.title))?)
    } else {
        None
    };
    let flash = board.flash(bootloader.is_some()).unwrap_or(board.chip.flash);
    check_folder(&args.out)?;
    eprintln!("building the firmware for the {}", board.title);
    let elf_path = build(args)?;
    let elf = fs::read(&elf_path).map_err(|error| format!("{}: {error}", elf_path.display()))?;
    let (start, mut flat) = flatten(&elf)?;
    if start != flash.start {
        return Err(format!("the image begins at {start:#010x} and not at {:#010x}", flash.start));
    }
    if let Some(bootloader) = bootloader {
        fill_descriptor(&mut flat, bootloader.board_id)?;
    }

    let mut name = format!("jetlink-{}", board.name);
    if args.ardupilot_bootloader {
        name += "-ardupilot";
    }
    if args.demo {
        name += "-demo";
    }
    let write = |ending: &str, bytes: &[u8]| {
        let path = args.out.join(format!("{name}.{ending}"));
        fs::write(&path, bytes).map_err(|error| format!("{}: {error}", path.display()))?;
        println!("{} ({} bytes)", path.display(), bytes.len());
        Ok::<_, String>(())
    };
    // The descriptor is filled in in the flat image only; a debug probe's loader needs none.
    write("elf", &elf)?;
    write("bin", &flat)?;
    write("hex", hex(start, &flat)?.as_bytes())?;
    if let Some(bootloader) = &bootloader {
        write("apj", apj(&flat, board, bootloader)?.as_bytes())?;
    }
    println!("{} bytes of flash from {start:#010x}", flat.len());
    if bootloader.is_some() {
        print!("{}", warning(board));
    }
    Ok(())
}

/// What the bootloader does to the ports before the image runs. Empty if all of them float.
fn warning(board: &Board) -> String {
    let ports = |before| -> Vec<String> {
        let ports = board.ports.iter().filter(|port| port.before == before);
        ports.map(|port| format!("{} ({})", port.name, port.label)).collect()
    };
    let mut text = String::new();
    let listens = ports(Before::Listens);
    if !listens.is_empty() {
        text += &format!(
            "Connect no ECU to {}: the bootloader listens there as well. It may take the bytes of an ECU for commands, and \
             then starts nothing, or erases the image.\n",
            listens.join(", ")
        );
    }
    let driven_low = ports(Before::DrivenLow);
    if !driven_low.is_empty() {
        text += &format!(
            "The bootloader drives TX low on {}, a break of 5 s after power-on: connect no ECU that this may disturb.\n",
            driven_low.join(", ")
        );
    }
    text
}

/// Checks that files can be written there, before a long build.
fn check_folder(out: &Path) -> Result<(), String> {
    let probe = out.join(format!(".jetlink-{}.part", std::process::id()));
    let written =
        fs::create_dir_all(out).and_then(|()| fs::write(&probe, "")).and_then(|()| fs::remove_file(&probe));
    written.map_err(|error| format!("cannot write into {}: {error}", out.display()))
}

/// The repository that this program was built in: the firmware is built from there, wherever it is called.
fn repository() -> Result<PathBuf, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    match root.canonicalize() {
        Ok(root) if root.join(".cargo/config.toml").is_file() => Ok(root),
        _ => Err(format!(
            "the sources of jetlink are no longer in {}: run `cargo image` inside a clone of the repository",
            root.display()
        )),
    }
}

/// Builds the firmware. Returns the path of its ELF file.
fn build(args: &Args) -> Result<PathBuf, String> {
    let mut features = format!("board-{}", args.board.name);
    if args.ardupilot_bootloader {
        features += ",ardupilot-bootloader";
    }
    if args.demo {
        features += ",demo";
    }
    // By name and by its alias: $CARGO may be another Rust than the one that every image is built with.
    let output = Command::new("cargo")
        .current_dir(repository()?)
        .args(["fw", &features, "--message-format", "json-render-diagnostics"])
        .stderr(Stdio::inherit())
        .output()
        .map_err(|error| format!("cargo cannot be started: {error}"))?;
    if !output.status.success() {
        return Err("the firmware was not built: see above".into());
    }
    let text = String::from_utf8_lossy(&output.stdout);
    text.lines()
        .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok())
        .filter_map(|message| message["executable"].as_str().map(PathBuf::from))
        .next_back()
        .ok_or_else(|| "cargo named no executable".into())
}

/// The content of the flash, in one piece, and its address. Gaps have the value of erased flash, and the
/// length is rounded up to 32 bytes, which an H7 writes at once.
fn flatten(elf: &[u8]) -> Result<(u32, Vec<u8>), String> {
    let file =
        object::File::parse(elf).map_err(|error| format!("the built file is not an ELF file: {error}"))?;
    let mut pieces: Vec<(u32, Vec<u8>)> = Vec::new();
    let object::File::Elf32(elf32) = &file else {
        return Err("the built file is not a 32-bit ELF file".into());
    };
    for header in elf32.elf_program_headers() {
        use object::read::elf::ProgramHeader;
        let endian = elf32.endian();
        let data = header.data(endian, elf).map_err(|()| "a segment lies outside the file".to_string())?;
        if header.p_type(endian) == object::elf::PT_LOAD && !data.is_empty() {
            // The place in the flash, not where start-up copies it to.
            pieces.push((header.p_paddr(endian), data.to_vec()));
        }
    }
    pieces.sort_by_key(|(at, _)| *at);
    let start = pieces.first().map(|(at, _)| *at).ok_or("the built file is empty")?;
    let mut flat = Vec::new();
    for (at, data) in pieces {
        let offset = (at - start) as usize;
        if offset < flat.len() {
            return Err("two segments overlap".into());
        }
        flat.resize(offset, 0xFF);
        flat.extend(data);
    }
    flat.resize(flat.len().next_multiple_of(32), 0xFF);
    Ok((start, flat))
}

/// Writes size and checksums into the application descriptor (ArduPilot, AP_CheckFirmware.cpp).
fn fill_descriptor(flat: &mut [u8], board_id: u16) -> Result<(), String> {
    let places: Vec<usize> = flat
        .windows(SIGNATURE.len())
        .enumerate()
        .filter(|(_, at)| *at == SIGNATURE)
        .map(|(i, _)| i)
        .collect();
    let [place] = places[..] else {
        return Err(format!("{} application descriptors in the image instead of one", places.len()));
    };
    let size = u32::try_from(flat.len()).map_err(|_| "the image is too large")?;
    let descriptor =
        flat.get_mut(place..place + DESCRIPTOR_LEN).ok_or("the application descriptor is cut off")?;
    if descriptor[26..28] != board_id.to_le_bytes() {
        return Err("the application descriptor names another board".into());
    }
    descriptor[16..20].copy_from_slice(&size.to_le_bytes());
    // The checksums and the numbers behind them are part of neither.
    let crc = Crc::<u32>::new(&CRC);
    let first = crc.checksum(&flat[..place + SIGNATURE.len()]);
    let second = crc.checksum(&flat[place + SECOND_PART..]);
    flat[place + 8..place + 12].copy_from_slice(&first.to_le_bytes());
    flat[place + 12..place + 16].copy_from_slice(&second.to_le_bytes());
    Ok(())
}

fn hex(start: u32, flat: &[u8]) -> Result<String, String> {
    let mut records = Vec::new();
    let mut upper = None;
    for (i, chunk) in flat.chunks(16).enumerate() {
        let address = start + i as u32 * 16;
        let high = (address >> 16) as u16;
        if upper.replace(high) != Some(high) {
            records.push(ihex::Record::ExtendedLinearAddress(high));
        }
        records.push(ihex::Record::Data { offset: address as u16, value: chunk.to_vec() });
    }
    records.push(ihex::Record::EndOfFile);
    ihex::create_object_file_representation(&records).map_err(|error| format!("Intel HEX: {error}"))
}

/// The JSON that ArduPilot's bootloader tools read.
fn apj(flat: &[u8], board: &Board, bootloader: &Bootloader) -> Result<String, String> {
    let mut zlib = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    let packed =
        zlib.write_all(flat).and_then(|()| zlib.finish()).map_err(|error| format!("zlib: {error}"))?;
    let json = serde_json::json!({
        "board_id": bootloader.board_id,
        "magic": "APJFWv1",
        "description": format!("jetlink for {}", board.name),
        "image": base64::engine::general_purpose::STANDARD.encode(packed),
        "image_size": flat.len(),
        "summary": board.name,
        "version": env!("CARGO_PKG_VERSION"),
        "git_identity": git_identity(),
        "board_revision": 0,
    });
    serde_json::to_string_pretty(&json).map_err(|error| format!("JSON: {error}"))
}

/// The commit, in a clone of the repository.
fn git_identity() -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    Command::new("git")
        .args(["rev-parse", "--short=8", "HEAD"])
        .current_dir(root)
        .output()
        .ok()
        .filter(|output| output.status.success())
        .map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned())
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ArduPilot's crc32_small, written out: no table, no inversion.
    fn crc32_small(mut crc: u32, bytes: &[u8]) -> u32 {
        for byte in bytes {
            crc ^= u32::from(*byte);
            for _ in 0..8 {
                crc = if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 };
            }
        }
        crc
    }

    fn image() -> Vec<u8> {
        let mut image: Vec<u8> = (0..4096u32).map(|i| (i * 7) as u8).collect();
        image[1000..1008].copy_from_slice(&SIGNATURE);
        image[1008..1036].fill(0);
        image[1026..1028].copy_from_slice(&1013u16.to_le_bytes());
        image[1028..1036].fill(0xFF);
        image
    }

    #[test]
    fn a_bootloader_that_checks_finds_both_checksums_right() {
        let mut image = image();
        fill_descriptor(&mut image, 1013).unwrap();
        let word = |at: usize| u32::from_le_bytes(image[at..at + 4].try_into().unwrap());
        // As check_good_firmware() does: up to image_crc1, and from version_major on.
        assert_eq!(word(1008), crc32_small(0, &image[..1008]));
        assert_eq!(word(1012), crc32_small(0, &image[1024..]));
        assert_eq!(word(1016), 4096);
    }

    #[test]
    fn an_image_without_its_descriptor_or_for_another_board_is_refused() {
        assert!(fill_descriptor(&mut vec![0; 4096], 1013).unwrap_err().contains("0 application descriptors"));
        assert!(fill_descriptor(&mut image(), 11).unwrap_err().contains("another board"));
    }

    #[test]
    fn ports_that_the_bootloader_uses_are_named() {
        let warning = |name| super::warning(Board::by_name(name).unwrap());
        assert_eq!(warning("matek-h743"), "");
        let pixhawk = warning("pixhawk-6c");
        assert!(
            pixhawk.contains("no ECU to SERIAL2 (TELEM2), SERIAL6 (FMU debug): the bootloader listens"),
            "{pixhawk}"
        );
        assert!(
            pixhawk.contains("TX low on SERIAL3 (GPS1), SERIAL4 (GPS2), SERIAL5 (TELEM3), a break"),
            "{pixhawk}"
        );
    }

    #[test]
    fn intel_hex_carries_the_address_over_64_kib() {
        let text = hex(0x0801_FFF0, &[0xAA; 32]).unwrap();
        let lines: Vec<_> = text.lines().collect();
        assert_eq!(lines[0], ":020000040801F1");
        assert_eq!(&lines[1][..9], ":10FFF000");
        assert_eq!(lines[2], ":020000040802F0");
        assert_eq!(*lines.last().unwrap(), ":00000001FF");
    }
}
