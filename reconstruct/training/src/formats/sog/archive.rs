//! ZIP archives of files that are compressed already, as SOG bundles them: written without compression, read with
//! Deflate too. The extensions for sizes of 64 bits are left out.

use std::{borrow::Cow, io::Read};

use flate2::{Crc, read::DeflateDecoder};

const LOCAL_HEADER: [u8; 4] = *b"PK\x03\x04";
const ENTRY: [u8; 4] = *b"PK\x01\x02";
const END: [u8; 4] = *b"PK\x05\x06";
const LOCAL_HEADER_BYTES: usize = 30;
const ENTRY_BYTES: usize = 46;
const END_BYTES: usize = 22;
/// Maximum bytes of the comment behind the directory.
const MOST_COMMENT_BYTES: usize = 65_535;
const STORED: u16 = 0;
const DEFLATED: u16 = 8;
/// Version 2.0 of the format.
const VERSION: u16 = 20;
/// Date of all files, 1 January 1980, so that equal contents give equal archives.
const DATE: u16 = 0x21;
/// Maximum size of a compressed file, bytes: images hardly become smaller, but hostile files do.
const MOST_INFLATED_BYTES: usize = 256 << 20;

pub(super) fn bundled(files: &[(&str, Vec<u8>)]) -> Result<Vec<u8>, String> {
    let word = |size: usize| {
        let word = u32::try_from(size).map_err(|_| "an archive without extensions holds 4 GiB");
        word.map(u32::to_le_bytes)
    };
    let half = |count: usize| (count as u16).to_le_bytes();
    let (mut bytes, mut directory) = (Vec::<u8>::new(), Vec::<u8>::new());
    for (name, content) in files {
        let at = word(bytes.len())?;
        let mut crc = Crc::new();
        crc.update(content);
        let mut fields = [VERSION, 0, STORED, 0, DATE].map(u16::to_le_bytes).concat();
        fields.extend(crc.sum().to_le_bytes());
        fields.extend(word(content.len())?);
        fields.extend(word(content.len())?);
        fields.extend(half(name.len()));
        fields.extend(half(0));
        bytes.extend(LOCAL_HEADER);
        bytes.extend(&fields);
        bytes.extend(name.as_bytes());
        bytes.extend(content);
        directory.extend(ENTRY);
        directory.extend(VERSION.to_le_bytes());
        directory.extend(&fields);
        // No comment, on the first disk, without attributes.
        directory.extend([0; 10]);
        directory.extend(at);
        directory.extend(name.as_bytes());
    }
    let at = word(bytes.len())?;
    let size = word(directory.len())?;
    bytes.extend(directory);
    bytes.extend(END);
    bytes.extend([0; 4]);
    bytes.extend([half(files.len()), half(files.len())].concat());
    bytes.extend([size, at].concat());
    bytes.extend(half(0));
    Ok(bytes)
}

#[derive(Debug)]
pub(super) struct Archive<'a> {
    bytes: &'a [u8],
    entries: Vec<Entry<'a>>,
}

/// A file of an archive.
#[derive(Debug, Clone, Copy)]
struct Entry<'a> {
    name: &'a [u8],
    method: u16,
    crc: u32,
    packed: usize,
    size: usize,
    at: usize,
}

impl<'a> Archive<'a> {
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self, String> {
        let tail_at = bytes
            .len()
            .saturating_sub(END_BYTES.saturating_add(MOST_COMMENT_BYTES));
        let tail = bytes.get(tail_at..).unwrap_or_default();
        let end = tail.windows(END.len()).rposition(|word| *word == END);
        let end = end.and_then(|at| tail.get(at..));
        let end =
            end.ok_or("is not a ZIP archive, or is cut off: the end of its directory is missing")?;
        let cut_off = || "is cut off in its directory".to_owned();
        let comment = usize::from(half(end, 20).ok_or_else(cut_off)?);
        if end.len() < END_BYTES.saturating_add(comment) {
            return Err(cut_off());
        }
        let count = half(end, 10).ok_or_else(cut_off)?;
        let directory_at = word(end, 16).ok_or_else(cut_off)?;
        let mut rest = bytes.get(directory_at as usize..).ok_or_else(cut_off)?;
        let mut entries = Vec::new();
        for _ in 0..count {
            let (entry, others) = Entry::split(rest).ok_or_else(cut_off)?;
            entries.push(entry);
            rest = others;
        }
        Ok(Self { bytes, entries })
    }

    pub(super) fn file(&self, name: &str) -> Result<Cow<'a, [u8]>, String> {
        let mut entries = self.entries.iter();
        let entry = entries
            .find(|entry| entry.name == name.as_bytes())
            .ok_or_else(|| format!("has no {name}"))?;
        let cut_off = || format!("is cut off in its {name}");
        let header = self.bytes.get(entry.at..).ok_or_else(cut_off)?;
        if !header.starts_with(&LOCAL_HEADER) {
            return Err(format!("has no {name} where its directory says"));
        }
        let lengths = half(header, 26).zip(half(header, 28)).ok_or_else(cut_off)?;
        let names = usize::from(lengths.0).saturating_add(usize::from(lengths.1));
        let packed = header
            .get(LOCAL_HEADER_BYTES.saturating_add(names)..)
            .and_then(|packed| packed.get(..entry.packed))
            .ok_or_else(cut_off)?;
        let content = match entry.method {
            STORED => Cow::Borrowed(packed),
            DEFLATED => Cow::Owned(inflated(name, packed, entry.size)?),
            method => {
                return Err(format!(
                    "has {name} in compression {method}, which is not read"
                ));
            }
        };
        let mut crc = Crc::new();
        crc.update(&content);
        if content.len() != entry.size || crc.sum() != entry.crc {
            return Err(format!("has another {name} than its checksum says"));
        }
        Ok(content)
    }
}

impl<'a> Entry<'a> {
    /// Splits the first entry off a directory.
    fn split(bytes: &'a [u8]) -> Option<(Self, &'a [u8])> {
        if !bytes.starts_with(&ENTRY) {
            return None;
        }
        let (name, others) = (half(bytes, 28)?, [half(bytes, 30)?, half(bytes, 32)?]);
        let (name, rest) = bytes
            .get(ENTRY_BYTES..)?
            .split_at_checked(usize::from(name))?;
        let others = others.map(usize::from);
        let entry = Self {
            name,
            method: half(bytes, 10)?,
            crc: word(bytes, 16)?,
            packed: word(bytes, 20)? as usize,
            size: word(bytes, 24)? as usize,
            at: word(bytes, 42)? as usize,
        };
        Some((entry, rest.get(others[0]..)?.get(others[1]..)?))
    }
}

fn inflated(name: &str, packed: &[u8], size: usize) -> Result<Vec<u8>, String> {
    if size > MOST_INFLATED_BYTES {
        return Err(format!("has a compressed {name} of {size} bytes, too many"));
    }
    let mut content = Vec::new();
    let mut decoder = DeflateDecoder::new(packed).take(size as u64);
    match decoder.read_to_end(&mut content) {
        Ok(_) => Ok(content),
        Err(error) => Err(format!("has {name}, which cannot be decompressed: {error}")),
    }
}

fn half(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}
