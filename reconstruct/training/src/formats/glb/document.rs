//! Lists, sizes and attributes of a glTF document; all sizes are checked against the binary part.

use std::array;

use serde_json::Value;

use super::{BYTE, FLOAT, SHORT, UNSIGNED_BYTE, UNSIGNED_SHORT, VALUES};

/// Returns the elements of a list of the document.
pub(super) fn list<'a>(of: &'a Value, name: &str) -> &'a [Value] {
    let list = of.get(name).and_then(Value::as_array);
    list.map_or(&[], Vec::as_slice)
}

/// Returns an entry of a list of the document, by its number in `of`.
pub(super) fn entry<'a>(document: &'a Value, name: &str, of: &Value) -> Result<&'a Value, String> {
    let number = of.as_u64().and_then(|number| usize::try_from(number).ok());
    number
        .and_then(|number| list(document, name).get(number))
        .ok_or_else(|| format!("names {of} of its {name}, which is not there"))
}

/// Returns a size of the document, or the default where it is missing.
pub(super) fn size(of: &Value, name: &str, default: usize) -> Result<usize, String> {
    let Some(value) = of.get(name) else {
        return Ok(default);
    };
    let number = value
        .as_u64()
        .and_then(|number| usize::try_from(number).ok());
    number.ok_or_else(|| format!("has {name} {value}, must be a size of 0 or more"))
}

/// Values of an attribute.
pub(super) struct Column<'a> {
    bytes: &'a [u8],
    stride: usize,
    pub(super) count: usize,
    component: u64,
    is_normalized: bool,
}

impl<'a> Column<'a> {
    /// Finds an attribute with so many components; the binary part holds all of it.
    pub(super) fn find(
        document: &Value,
        binary: &'a [u8],
        accessor: &Value,
        width: usize,
    ) -> Result<Self, String> {
        let accessor = entry(document, "accessors", accessor)?;
        if accessor.get("sparse").is_some() {
            return Err("has a sparse accessor, which is not read".to_owned());
        }
        let view = accessor.get("bufferView");
        let view = view.ok_or("has an accessor without a bufferView: it is compressed")?;
        let view = entry(document, "bufferViews", view)?;
        let buffer = entry(
            document,
            "buffers",
            view.get("buffer").unwrap_or(&Value::Null),
        )?;
        if size(view, "buffer", 0)? != 0 || buffer.get("uri").is_some() {
            return Err("has values in another file, which is not read".to_owned());
        }
        let kind = accessor.get("type").and_then(Value::as_str);
        if VALUES
            .iter()
            .all(|(values, name)| *values != width || kind != Some(*name))
        {
            return Err(format!(
                "has an attribute of another type than {width} components"
            ));
        }
        let component = accessor.get("componentType").and_then(Value::as_u64);
        let component = component.unwrap_or_default();
        let component_size = match component {
            FLOAT => 4_usize,
            SHORT | UNSIGNED_SHORT => 2,
            BYTE | UNSIGNED_BYTE => 1,
            other => {
                return Err(format!(
                    "has components of type {other}, which are not read"
                ));
            }
        };
        let row = component_size.saturating_mul(width);
        let stride = size(view, "byteStride", row)?;
        let count = size(accessor, "count", 0)?;
        let within = size(accessor, "byteOffset", 0)?;
        let begin = size(view, "byteOffset", 0)?;
        let end = begin.saturating_add(size(view, "byteLength", 0)?);
        let bytes = binary.get(begin..end).and_then(|view| view.get(within..));
        let bytes = bytes.ok_or("is cut off: a view ends behind the binary part")?;
        let wanted = count
            .saturating_sub(1)
            .saturating_mul(stride)
            .saturating_add(row);
        if stride < row || (count > 0 && wanted > bytes.len()) {
            return Err(format!(
                "has an accessor of {count} values that its view does not hold"
            ));
        }
        Ok(Self {
            bytes,
            stride,
            count,
            component,
            is_normalized: accessor.get("normalized") == Some(&Value::Bool(true)),
        })
    }

    /// Returns a row; `index` must be below the number of rows.
    pub(super) fn row<const N: usize>(&self, index: usize) -> [f32; N] {
        let row = self.bytes.get(index.saturating_mul(self.stride)..);
        let row = row.unwrap_or_default();
        let two = |at: usize| row.as_chunks::<2>().0.get(at).copied().unwrap_or_default();
        let one = |at: usize| row.get(at).copied().unwrap_or_default();
        array::from_fn(|at| {
            let (value, most) = match self.component {
                FLOAT => {
                    let bytes = row.as_chunks::<4>().0.get(at).copied();
                    return f32::from_le_bytes(bytes.unwrap_or_default());
                }
                SHORT => (f32::from(i16::from_le_bytes(two(at))), 32_767.0),
                UNSIGNED_SHORT => (f32::from(u16::from_le_bytes(two(at))), 65_535.0),
                BYTE => (f32::from(i8::from_le_bytes([one(at)])), 127.0),
                _ => (f32::from(one(at)), 255.0),
            };
            if self.is_normalized {
                (value / most).max(-1.0)
            } else {
                value
            }
        })
    }
}
