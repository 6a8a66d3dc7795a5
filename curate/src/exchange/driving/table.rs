//! Text files of drives: numbers that are finite, in lines of a fixed width.

use std::path::Path;

use omnilife_schemas::store::{self, StoreError};

/// Size of a text file that is certainly too large, bytes.
const MOST_BYTES: u64 = 1 << 28;

/// Reads a text file.
///
/// # Errors
/// When it is missing, larger than 256 MiB or not UTF-8.
pub(super) fn text(path: &Path) -> Result<String, StoreError> {
    String::from_utf8(store::read_limited(path, MOST_BYTES)?).map_err(|error| {
        let place = error.utf8_error().valid_up_to();
        StoreError::malformed(path, format!("must be UTF-8, which ends at byte {place}"))
    })
}

/// Returns lines with text and their numbers, counted from 1.
pub(super) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    (1_usize..)
        .zip(text.lines())
        .filter(|(_, line)| !line.trim().is_empty())
}

/// Parses the words of a line as finite numbers.
///
/// # Errors
/// When a word is not a finite number; the message has the word and the line.
pub(super) fn numbers<'a>(
    words: impl Iterator<Item = &'a str>,
    line: usize,
) -> Result<Vec<f64>, String> {
    words
        .map(|word| {
            let number: Option<f64> = word.parse().ok().filter(|number: &f64| number.is_finite());
            number.ok_or_else(|| format!("line {line} must hold finite numbers, got {word:?}"))
        })
        .collect()
}

/// Parses the words of a line as `N` finite numbers, of which `what` says what they are.
///
/// # Errors
/// When there are more or fewer words than `N`, or a word is not a finite number; the message has the line.
pub(super) fn exactly<'a, const N: usize>(
    words: impl Iterator<Item = &'a str>,
    line: usize,
    what: &str,
) -> Result<[f64; N], String> {
    <[f64; N]>::try_from(numbers(words, line)?)
        .map_err(|found| format!("line {line} must hold {N} {what}, got {}", found.len()))
}
