//! ICC colour profiles of image files: nothing applies them, so that those of other colours than sRGB are told.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

/// Start of the table of tags in an ICC profile, bytes: the header, and the number of tags.
const TAGS: usize = 132;
/// Size of an entry of that table, bytes: signature, offset and size.
const TAG_ENTRY: usize = 12;

/// Returns true for a profile whose description begins with "sRGB", as GIMP calls it too; not for one whose values are
/// linear, as those named by a gamma of 1 ("sRGB-elle-V2-g10").
pub fn is_srgb(profile: &[u8]) -> bool {
    description(profile).is_some_and(|text| {
        let text = text.trim_start();
        let text = text.strip_prefix("GIMP built-in ").unwrap_or(text);
        text.starts_with("sRGB") && !text.contains("-g10")
    })
}

/// Returns the description of an ICC profile; `None` for a profile without one. It is text in UTF-16 since version 4
/// (ICC.1:2022, sections 7.3 and 10.15) and in ASCII before (ICC.1:2001-04, section 6.5.17).
fn description(profile: &[u8]) -> Option<String> {
    let mut entries = profile.get(TAGS..)?.chunks_exact(TAG_ENTRY);
    let entry = entries.find(|entry| entry.starts_with(b"desc"))?;
    let tag = profile.get(number(entry, 4)?..)?;
    if tag.starts_with(b"mluc") {
        let (length, offset) = (number(tag, 20)?, number(tag, 24)?);
        let text = tag.get(offset..)?.get(..length)?;
        let (pairs, _) = text.as_chunks::<2>();
        let units: Vec<u16> = pairs.iter().map(|pair| u16::from_be_bytes(*pair)).collect();
        return Some(String::from_utf16_lossy(&units));
    }
    let text = tag.strip_prefix(b"desc")?.get(8..)?;
    let end = text.iter().position(|&byte| byte == 0);
    let text = text.get(..end.unwrap_or(text.len()))?;
    Some(String::from_utf8_lossy(text).into_owned())
}

/// Returns the big-endian number of four bytes at a place.
fn number(bytes: &[u8], at: usize) -> Option<usize> {
    let four = bytes.get(at..)?.first_chunk::<4>()?;
    usize::try_from(u32::from_be_bytes(*four)).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Makes a profile of one tag.
    fn profile(tag: &[u8]) -> Vec<u8> {
        let mut bytes = vec![0; 128];
        bytes.extend(1_u32.to_be_bytes());
        bytes.extend(b"desc");
        bytes.extend(144_u32.to_be_bytes());
        bytes.extend((tag.len() as u32).to_be_bytes());
        bytes.extend(tag);
        bytes
    }

    fn ascii(text: &str) -> Vec<u8> {
        let length = (text.len() as u32 + 1).to_be_bytes();
        let tag = [&b"desc\0\0\0\0"[..], &length, text.as_bytes(), b"\0"];
        profile(&tag.concat())
    }

    fn utf16(text: &str) -> Vec<u8> {
        let text: Vec<u8> = text.encode_utf16().flat_map(u16::to_be_bytes).collect();
        let mut tag = b"mluc\0\0\0\0".to_vec();
        for number in [1, 12] {
            tag.extend(u32::to_be_bytes(number));
        }
        tag.extend(b"enUS");
        for number in [text.len() as u32, 28] {
            tag.extend(number.to_be_bytes());
        }
        tag.extend(text);
        profile(&tag)
    }

    #[test]
    fn profiles_are_told_by_their_description() {
        for text in [
            "sRGB IEC61966-2.1",
            "sRGB built-in",
            "GIMP built-in sRGB",
            "sRGB-elle-V2-srgbtrc.icc",
        ] {
            assert!(is_srgb(&ascii(text)) && is_srgb(&utf16(text)), "{text}");
        }
        for text in [
            "Display P3",
            "Display P3 Gamut with sRGB Transfer",
            "GIMP built-in Linear sRGB",
            "sRGB-elle-V2-g10.icc",
        ] {
            assert!(!is_srgb(&ascii(text)) && !is_srgb(&utf16(text)), "{text}");
        }
        let whole = utf16("sRGB");
        for length in 0..whole.len() {
            assert!(!is_srgb(&whole[..length]), "cut off at {length}");
        }
    }
}
