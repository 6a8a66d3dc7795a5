//! Numbers on the command line: parsers whose errors say which numbers an option accepts.
//!
//! clap puts the option and the value before each text.

use std::any::TypeId;

use clap::Arg;

/// Parses a whole number from 0 on.
pub(super) fn whole<T: TryFrom<u64>>(text: &str) -> Result<T, String> {
    between::<T, 0, { u64::MAX }>(text)
}

/// Parses a whole number from 1 on.
pub(super) fn count<T: TryFrom<u64>>(text: &str) -> Result<T, String> {
    between::<T, 1, { u64::MAX }>(text)
}

/// Parses a whole number from `LEAST` to `MOST`, or to the largest one of its type.
pub(super) fn between<T: TryFrom<u64>, const LEAST: u64, const MOST: u64>(
    text: &str,
) -> Result<T, String> {
    let number: Option<u64> = text.parse().ok();
    let in_range = number.filter(|number| (LEAST..=MOST).contains(number));
    in_range
        .and_then(|number| T::try_from(number).ok())
        .ok_or_else(|| match (MOST, number) {
            (u64::MAX, Some(number)) if number >= LEAST => {
                format!("must be a smaller whole number of at least {LEAST}")
            }
            (u64::MAX, _) => format!("must be a whole number of at least {LEAST}"),
            (most, _) => format!("must be a whole number from {LEAST} to {most}"),
        })
}

/// Parses a number, without infinity and NaN.
pub(super) fn finite(text: &str) -> Result<f64, String> {
    number(text, |_| true, "must be a number")
}

/// Parses a number above 0.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    number(text, |number| number > 0.0, "must be a positive number")
}

/// Parses a number from 0 on.
pub(super) fn not_negative(text: &str) -> Result<f64, String> {
    number(
        text,
        |number| number >= 0.0,
        "must be a number of at least 0",
    )
}

fn number(text: &str, is_accepted: impl Fn(f64) -> bool, requirement: &str) -> Result<f64, String> {
    let number: Option<f64> = text.parse().ok();
    number
        .filter(|number| number.is_finite() && is_accepted(*number))
        .ok_or_else(|| requirement.to_owned())
}

/// Returns whether the values of an option are numbers.
pub(super) fn is_number(option: &Arg) -> bool {
    let values = option.get_value_parser().type_id();
    let is_of_numbers = [
        TypeId::of::<u16>(),
        TypeId::of::<u32>(),
        TypeId::of::<u64>(),
        TypeId::of::<usize>(),
        TypeId::of::<f64>(),
    ]
    .into_iter()
    .any(|numbers| values == numbers);
    is_of_numbers && option.get_long().is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_have_bounds() {
        assert_eq!(whole::<u64>("0"), Ok(0));
        assert_eq!(whole::<u64>("18446744073709551615"), Ok(u64::MAX));
        assert_eq!(count::<u32>("4294967295"), Ok(u32::MAX));
        assert_eq!(between::<u16, 64, 4096>("4096"), Ok(4096));
        for text in ["0", "-4", "1.5", "", "nonsense", "4294967296"] {
            assert!(count::<u32>(text).is_err(), "{text}");
        }
        for text in ["63", "4097", "70000"] {
            assert!(between::<u16, 64, 4096>(text).is_err(), "{text}");
        }
    }

    #[test]
    fn numbers_are_finite() {
        assert_eq!(finite("-0.5"), Ok(-0.5));
        assert_eq!(not_negative("0"), Ok(0.0));
        assert_eq!(positive("1e-308"), Ok(1e-308));
        for text in ["nan", "inf", "-inf", "", "1,5"] {
            assert!(finite(text).is_err(), "{text}");
        }
        for text in ["0", "-4", "nan"] {
            assert!(positive(text).is_err(), "{text}");
        }
        assert!(not_negative("-0.1").is_err());
    }
}
