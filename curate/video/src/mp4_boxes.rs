//! Boxes of MP4 and MOV files (ISO 14496-12, 4.2): reading and writing.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::io::{self, Cursor, Read, Seek, SeekFrom};

/// Bytes of a visual sample entry before the boxes in it, its own header not counted (12.1.3).
pub(crate) const VISUAL_ENTRY_BYTES: usize = 78;
/// Maximum number of boxes that are searched in one part.
const MOST_BOXES: usize = 10_000;

/// Four-character type of a box.
pub(crate) type Kind = [u8; 4];

/// A part of the file, in bytes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Span {
    pub(crate) begin: u64,
    pub(crate) end: u64,
}

/// Returns the payloads of the boxes of one kind directly in a part.
pub(crate) fn children(
    file: &mut (impl Read + Seek),
    span: Span,
    kind: &Kind,
) -> io::Result<Vec<Span>> {
    Ok(boxes(file, span)?
        .into_iter()
        .filter(|(found, _)| found == kind)
        .map(|(_, payload)| payload)
        .collect())
}

/// Kinds and payloads of the boxes directly in a part, up to the first that does not fit into it.
pub(crate) fn boxes(file: &mut (impl Read + Seek), span: Span) -> io::Result<Vec<(Kind, Span)>> {
    let mut found = Vec::new();
    let mut at = span.begin;
    while at.saturating_add(8) <= span.end && found.len() < MOST_BOXES {
        file.seek(SeekFrom::Start(at))?;
        let short = u64::from(u32::from_be_bytes(array(file)?));
        let kind = array(file)?;
        let (header, size) = match short {
            0 => (8, span.end.saturating_sub(at)),
            1 if at.saturating_add(16) <= span.end => (16, u64::from_be_bytes(array(file)?)),
            size => (8, size),
        };
        let Some(end) = at.checked_add(size).filter(|&end| end <= span.end) else {
            break;
        };
        if size < header {
            break;
        }
        let begin = at.saturating_add(header);
        found.push((kind, Span { begin, end }));
        at = end;
    }
    Ok(found)
}

fn array<const N: usize>(file: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    file.read_exact(&mut bytes)?;
    Ok(bytes)
}

/// Returns `N` bytes of a part from an offset, if it is that long.
pub(crate) fn bytes_at<const N: usize>(
    file: &mut (impl Read + Seek),
    span: Span,
    offset: u64,
) -> io::Result<Option<[u8; N]>> {
    let begin = span.begin.saturating_add(offset);
    if begin.saturating_add(N as u64) > span.end {
        return Ok(None);
    }
    file.seek(SeekFrom::Start(begin))?;
    array(file).map(Some)
}

/// Returns kinds and payloads of the boxes in `bytes`; some files end a list of boxes by four zero bytes, which are
/// left out.
///
/// # Errors
/// When a box is longer than `bytes`.
pub(crate) fn in_bytes(bytes: &[u8]) -> io::Result<Vec<(Kind, &[u8])>> {
    let end = bytes.len() as u64;
    let found = boxes(&mut Cursor::new(bytes), Span { begin: 0, end })?;
    let last = found.last().map_or(0, |(_, payload)| payload.end);
    if end.saturating_sub(last) >= 8 {
        let reason = "a box is longer than what holds it";
        return Err(io::Error::new(io::ErrorKind::InvalidData, reason));
    }
    let of = |span: Span| {
        bytes
            .get(span.begin as usize..span.end as usize)
            .unwrap_or_default()
    };
    Ok(found
        .into_iter()
        .map(|(kind, span)| (kind, of(span)))
        .collect())
}

#[expect(clippy::arithmetic_side_effects, reason = "boxes of our own are short")]
pub(crate) fn boxed(kind: Kind, content: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(content.len() + 8);
    bytes.extend((content.len() as u32 + 8).to_be_bytes());
    bytes.extend(kind);
    bytes.extend(content);
    bytes
}
