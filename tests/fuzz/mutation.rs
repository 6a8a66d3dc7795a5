//! Random changes of files, from a seed.

/// Numbers at the limits of types, and beyond.
const NUMBERS: [&str; 22] = [
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "127",
    "128",
    "255",
    "256",
    "32768",
    "65535",
    "65536",
    "2147483647",
    "-2147483648",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "18446744073709551615",
    "1e39",
    "1e308",
    "-1e-320",
    "nan",
];

/// Source of changes; the same seed and words make the same changes.
pub(crate) struct Mutator {
    state: u64,
    words: &'static [&'static str],
}

impl Mutator {
    pub(crate) fn new(seed: u64, words: &'static [&'static str]) -> Self {
        Self { state: seed, words }
    }

    /// Returns the next number of `SplitMix64`.
    fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.state;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// Returns a number below `end`, 0 where that is 0.
    fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }

    fn pick<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())]
    }

    /// Returns one of the seeds, changed in one to eight ways, with its number.
    pub(crate) fn changed(&mut self, seeds: &[&[u8]]) -> (usize, Vec<u8>) {
        let seed = self.below(seeds.len());
        let mut bytes = seeds[seed].to_vec();
        for _ in 0..=self.below(8) {
            self.change(&mut bytes, seeds);
        }
        (seed, bytes)
    }

    fn change(&mut self, bytes: &mut Vec<u8>, seeds: &[&[u8]]) {
        let at = self.below(bytes.len());
        let end = at + self.below((bytes.len() - at).min(64) + 1);
        match self.below(10) {
            0 if !bytes.is_empty() => bytes[at] ^= 1 << self.below(8),
            1 if !bytes.is_empty() => bytes[at] = self.pick(&[0, 1, 0x7f, 0x80, 0xff, b'\n', b' ']),
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..end)),
            4 => {
                let copy = bytes[at..end].to_vec();
                bytes.splice(at..at, copy);
            }
            5 => {
                let word = self.word();
                let end = if self.below(2) == 0 { at } else { end };
                bytes.splice(at..end, word);
            }
            6 => self.change_number(bytes, at),
            7 => self.change_integer(bytes, at),
            8 => {
                let other = self.pick(seeds);
                let from = self.below(other.len());
                let to = (from + self.below(128)).min(other.len());
                bytes.splice(at..end, other[from..to].iter().copied());
            }
            _ => {
                let noise: Vec<u8> = (0..self.below(16)).map(|_| self.next() as u8).collect();
                bytes.splice(at..at, noise);
            }
        }
    }

    fn word(&mut self) -> Vec<u8> {
        if self.words.is_empty() || self.below(3) == 0 {
            return self.pick(&NUMBERS).into();
        }
        self.pick(self.words).into()
    }

    /// Overwrites the next number in digits with another one.
    fn change_number(&mut self, bytes: &mut Vec<u8>, at: usize) {
        let is_digit = |byte: &u8| byte.is_ascii_digit() || b".+-eE".contains(byte);
        let Some(begin) = bytes[at..].iter().position(u8::is_ascii_digit) else {
            return;
        };
        let begin = at + begin;
        let digits = bytes[begin..]
            .iter()
            .take_while(|byte| is_digit(byte))
            .count();
        let number = self.pick(&NUMBERS);
        bytes.splice(begin..begin + digits, number.bytes());
    }

    /// Overwrites bytes with an extreme integer of 2, 4 or 8 bytes.
    fn change_integer(&mut self, bytes: &mut [u8], at: usize) {
        let number = match self.below(6) {
            0 => 0,
            1 => u64::MAX,
            2 => i64::MAX as u64,
            3 => u64::from(u32::MAX),
            4 => 1 << 31,
            _ => self.next() % 1024,
        };
        let width = self.pick(&[2, 4, 8]);
        let ordered = if self.below(2) == 0 {
            number.to_le_bytes()[..width].to_vec()
        } else {
            number.to_be_bytes()[8 - width..].to_vec()
        };
        for (to, from) in bytes.iter_mut().skip(at).zip(ordered) {
            *to = from;
        }
    }
}
