//! Landmarks of OpenVSLAM's map, a MessagePack file
//! (`src/openvslam/io/map_database_io.cc` and `landmark::to_json` of `xdspacelab/openvslam`;
//! <https://github.com/msgpack/msgpack/blob/master/spec.md>).
//!
//! The file is a map. Its entry `landmarks` is a map of landmarks by their number, or nil without any. The entry
//! `pos_w` of a landmark is its place in the world, three numbers. All else is skipped.

/// Reads the places of the landmarks from the bytes of a map.
///
/// # Errors
/// Byte position and the expected content.
pub(super) fn positions(bytes: &[u8]) -> Result<Vec<[f64; 3]>, String> {
    let mut reader = Reader { rest: bytes };
    read_map(&mut reader).map_err(|reason| {
        let place = bytes.len().saturating_sub(reader.rest.len());
        format!("byte {place}: {reason}")
    })
}

fn read_map(reader: &mut Reader<'_>) -> Result<Vec<[f64; 3]>, String> {
    let Value::Map(entries) = reader.value()? else {
        return Err("is not a map of OpenVSLAM".to_owned());
    };
    for _ in 0..entries {
        if reader.value()? != Value::Text(b"landmarks") {
            reader.skip()?;
            continue;
        }
        return match reader.value()? {
            Value::Nil => Ok(Vec::new()),
            Value::Map(count) => (0..count)
                .map(|_| {
                    reader.skip()?;
                    read_landmark(reader)
                })
                .collect(),
            _ => Err("landmarks are not a map".to_owned()),
        };
    }
    Err("the map has no landmarks entry".to_owned())
}

fn read_landmark(reader: &mut Reader<'_>) -> Result<[f64; 3], String> {
    let Value::Map(entries) = reader.value()? else {
        return Err("a landmark is not a map".to_owned());
    };
    let mut place = None;
    for _ in 0..entries {
        if reader.value()? != Value::Text(b"pos_w") {
            reader.skip()?;
            continue;
        }
        if reader.value()? != Value::Array(3) {
            return Err("pos_w of a landmark has not three numbers".to_owned());
        }
        place = Some([reader.number()?, reader.number()?, reader.number()?]);
    }
    place.ok_or_else(|| "a landmark has no pos_w".to_owned())
}

/// A value of MessagePack; for arrays and maps, the number of entries that follow.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Value<'a> {
    Nil,
    Number(f64),
    Text(&'a [u8]),
    Array(u32),
    /// Number of pairs.
    Map(u32),
    /// Booleans, binary data and extensions.
    Other,
}

struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let (taken, rest) = self
            .rest
            .split_at_checked(count)
            .ok_or_else(|| "the file ends within a value".to_owned())?;
        self.rest = rest;
        Ok(taken)
    }

    fn bytes<const COUNT: usize>(&mut self) -> Result<[u8; COUNT], String> {
        let (taken, rest) = self
            .rest
            .split_first_chunk()
            .ok_or_else(|| "the file ends within a value".to_owned())?;
        self.rest = rest;
        Ok(*taken)
    }

    fn length8(&mut self) -> Result<u32, String> {
        Ok(u32::from(u8::from_be_bytes(self.bytes()?)))
    }

    fn length16(&mut self) -> Result<u32, String> {
        Ok(u32::from(u16::from_be_bytes(self.bytes()?)))
    }

    fn length32(&mut self) -> Result<u32, String> {
        Ok(u32::from_be_bytes(self.bytes()?))
    }

    fn text(&mut self, length: u32) -> Result<Value<'a>, String> {
        Ok(Value::Text(self.take(length as usize)?))
    }

    /// Skips data of a length, behind so many bytes of a type.
    fn other(&mut self, length: u32, type_bytes: usize) -> Result<Value<'a>, String> {
        self.take(type_bytes)?;
        self.take(length as usize)?;
        Ok(Value::Other)
    }

    fn value(&mut self) -> Result<Value<'a>, String> {
        let [kind] = self.bytes()?;
        Ok(match kind {
            0x00..=0x7f => Value::Number(f64::from(kind)),
            0x80..=0x8f => Value::Map(u32::from(kind & 0x0f)),
            0x90..=0x9f => Value::Array(u32::from(kind & 0x0f)),
            0xa0..=0xbf => self.text(u32::from(kind & 0x1f))?,
            0xc0 => Value::Nil,
            0xc1 => return Err("has the byte c1, which MessagePack does not use".to_owned()),
            0xc2 | 0xc3 => Value::Other,
            0xc4 => {
                let length = self.length8()?;
                self.other(length, 0)?
            }
            0xc5 => {
                let length = self.length16()?;
                self.other(length, 0)?
            }
            0xc6 => {
                let length = self.length32()?;
                self.other(length, 0)?
            }
            0xc7 => {
                let length = self.length8()?;
                self.other(length, 1)?
            }
            0xc8 => {
                let length = self.length16()?;
                self.other(length, 1)?
            }
            0xc9 => {
                let length = self.length32()?;
                self.other(length, 1)?
            }
            0xca => Value::Number(f64::from(f32::from_be_bytes(self.bytes()?))),
            0xcb => Value::Number(f64::from_be_bytes(self.bytes()?)),
            0xcc => Value::Number(f64::from(u8::from_be_bytes(self.bytes()?))),
            0xcd => Value::Number(f64::from(u16::from_be_bytes(self.bytes()?))),
            0xce => Value::Number(f64::from(u32::from_be_bytes(self.bytes()?))),
            0xcf => Value::Number(u64::from_be_bytes(self.bytes()?) as f64),
            0xd0 => Value::Number(f64::from(i8::from_be_bytes(self.bytes()?))),
            0xd1 => Value::Number(f64::from(i16::from_be_bytes(self.bytes()?))),
            0xd2 => Value::Number(f64::from(i32::from_be_bytes(self.bytes()?))),
            0xd3 => Value::Number(i64::from_be_bytes(self.bytes()?) as f64),
            0xd4 => self.other(1, 1)?,
            0xd5 => self.other(2, 1)?,
            0xd6 => self.other(4, 1)?,
            0xd7 => self.other(8, 1)?,
            0xd8 => self.other(16, 1)?,
            0xd9 => {
                let length = self.length8()?;
                self.text(length)?
            }
            0xda => {
                let length = self.length16()?;
                self.text(length)?
            }
            0xdb => {
                let length = self.length32()?;
                self.text(length)?
            }
            0xdc => Value::Array(self.length16()?),
            0xdd => Value::Array(self.length32()?),
            0xde => Value::Map(self.length16()?),
            0xdf => Value::Map(self.length32()?),
            0xe0..=0xff => Value::Number(f64::from(i8::from_be_bytes([kind]))),
        })
    }

    /// Reads a number that a point may have as a coordinate, in 32-bit floats too.
    fn number(&mut self) -> Result<f64, String> {
        match self.value()? {
            Value::Number(value) if (value as f32).is_finite() => Ok(value),
            Value::Number(value) => Err(format!("pos_w of a landmark has the value {value}")),
            _ => Err("pos_w of a landmark must have numbers alone".to_owned()),
        }
    }

    /// Skips a value with all that is in it, without recursion: every step takes a byte.
    fn skip(&mut self) -> Result<(), String> {
        let mut open: u64 = 1;
        while let Some(others) = open.checked_sub(1) {
            let inside = match self.value()? {
                Value::Array(count) => u64::from(count),
                Value::Map(pairs) => u64::from(pairs).saturating_mul(2),
                _ => 0,
            };
            open = others.saturating_add(inside);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a text of MessagePack, shorter than 32 bytes.
    fn text(text: &str) -> Vec<u8> {
        let mut bytes = vec![0xa0 | text.len() as u8];
        bytes.extend(text.bytes());
        bytes
    }

    /// Returns a map of one landmark, whose `pos_w` has this content, behind this other entry.
    fn map(other: &[u8], pos_w: &[u8]) -> Vec<u8> {
        [
            &[0x82][..],
            &text("keyframes"),
            other,
            &text("landmarks"),
            &[0x81],
            &text("17"),
            &[0x82],
            &text("n_vis"),
            &[0xcd, 1, 44],
            &text("pos_w"),
            pos_w,
        ]
        .concat()
    }

    #[test]
    fn numbers_of_every_width_are_coordinates() {
        let half = 0.5_f32.to_be_bytes();
        let third = (1.0_f64 / 3.0).to_be_bytes();
        let floats = [&[0x93, 0xca][..], &half, &[0xcb], &third, &[0xe0]].concat();
        assert_eq!(
            positions(&map(&[0xc0], &floats)),
            Ok(vec![[0.5, 1.0 / 3.0, -32.0]])
        );
        let integers = [0x93, 0xd1, 0xff, 0x00, 0xce, 0, 1, 0, 0, 0x7f];
        assert_eq!(
            positions(&map(&[0xc0], &integers)),
            Ok(vec![[-256.0, 65_536.0, 127.0]])
        );
    }

    #[test]
    fn values_of_every_kind_are_skipped() {
        let place = [0x93, 1, 2, 3];
        for other in [
            &[0xc3][..],
            &[0xc4, 2, 9, 9],
            &[0xc8, 0, 1, 5, 9],
            &[0xd6, 5, 1, 2, 3, 4],
            &[0xd9, 3, b'a', b'b', b'c'],
            &[0xdc, 0, 2, 0x81, 0xa1, b'k', 0x92, 1, 2, 0xc2],
            &[0xdf, 0, 0, 0, 1, 0x00, 0x90],
        ] {
            assert_eq!(
                positions(&map(other, &place)),
                Ok(vec![[1.0, 2.0, 3.0]]),
                "{other:?}"
            );
        }
    }

    #[test]
    fn what_is_no_map_names_its_byte() {
        let whole = map(&[0xc0], &[0x93, 1, 2, 3]);
        for length in 0..whole.len() {
            let cut = positions(&whole[..length]);
            assert!(cut.is_err_and(|line| line.starts_with("byte ")), "{length}");
        }
        let infinite = f64::INFINITY.to_be_bytes();
        let no_number = [&[0x93, 1, 2, 0xcb][..], &infinite].concat();
        for pos_w in [&no_number[..], &[0x92, 1, 2], &[0x93, 1, 2, 0xc0], &[0xc1]] {
            assert!(positions(&map(&[0xc0], pos_w)).is_err(), "{pos_w:?}");
        }
        // Four thousand million entries that are not there.
        assert!(positions(&map(&[0xdf, 0xff, 0xff, 0xff, 0xff], &[0x93, 1, 2, 3])).is_err());
        let no_landmarks = [&[0x81][..], &text("cameras"), &[0xc0]].concat();
        assert!(positions(&no_landmarks).is_err());
        let empty = [&[0x81][..], &text("landmarks"), &[0xc0]].concat();
        assert_eq!(positions(&empty), Ok(Vec::new()));
    }
}
