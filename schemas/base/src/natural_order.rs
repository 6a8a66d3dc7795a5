//! Natural order of names: a run of digits counts as the number that it is, so `2.png` comes before `10.png`.

use std::{cmp::Ordering, path::Path};

/// A part of a name.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
enum Piece<'a> {
    /// Without leading zeros; the longer one is the larger.
    Number {
        length: usize,
        digits: &'a str,
    },
    Text(&'a str),
}

fn pieces(name: &str) -> Vec<Piece<'_>> {
    let mut pieces = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let is_number = rest.starts_with(|letter: char| letter.is_ascii_digit());
        let end = rest
            .find(|letter: char| letter.is_ascii_digit() != is_number)
            .unwrap_or(rest.len());
        let (piece, after) = rest.split_at(end);
        pieces.push(if is_number {
            let digits = piece.trim_start_matches('0');
            Piece::Number {
                length: digits.len(),
                digits,
            }
        } else {
            Piece::Text(piece)
        });
        rest = after;
    }
    pieces
}

/// Returns the order of two names or paths.
pub fn natural(a: &str, b: &str) -> Ordering {
    pieces(a).cmp(&pieces(b)).then_with(|| a.cmp(b))
}

/// Returns the order of two files.
pub fn natural_paths(a: &Path, b: &Path) -> Ordering {
    natural(&a.to_string_lossy(), &b.to_string_lossy())
}

/// Returns the number of a frame by its file.
pub fn number(file: &Path) -> Option<u64> {
    let stem = file.file_stem()?.to_string_lossy();
    let last = pieces(&stem)
        .into_iter()
        .rev()
        .find_map(|piece| match piece {
            Piece::Number { digits, .. } => Some(digits),
            Piece::Text(_) => None,
        })?;
    if last.is_empty() {
        return Some(0);
    }
    last.parse().ok()
}
