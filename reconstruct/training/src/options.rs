//! Options of single methods: declared by the method, checked before any computation.
//! `--set densify-threshold=2e-4` sets one.

use std::collections::BTreeMap;

use omnilife_engine::{gaussians::MAX_SH_DEGREE, render::settings::Footprint};
use omnilife_schemas::names;
use serde::Serialize;

use crate::error::ReconstructError;

/// An option of a method.
#[derive(Debug, Clone, Copy)]
pub struct MethodOption {
    /// Name on the command line.
    pub id: &'static str,
    /// Effect of the option.
    pub doc: &'static str,
    /// Allowed values.
    pub values: OptionValues,
    /// Default value.
    pub default: &'static str,
    /// Its publication, if it is a constant of a published method. A variant with another value has it in its name.
    pub constant: Option<Constant>,
    /// Words that only the CPU has.
    pub cpu_only: &'static [&'static str],
}

/// Constant of a published method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Constant {
    /// Unit; empty for words and pure numbers.
    pub unit: &'static str,
    /// Equation, section or file in the publication.
    pub source: &'static str,
    /// Component that it belongs to: without it the constant has no effect.
    pub component: Option<&'static str>,
    /// True for the weight of the component's loss, or the length of its steps.
    pub is_weight: bool,
}

/// Values of an option.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OptionValues {
    /// Whole numbers.
    Whole {
        /// Minimum.
        least: u64,
        /// Maximum.
        most: u64,
    },
    /// Numbers.
    Number {
        /// Minimum.
        least: f64,
        /// Maximum.
        most: f64,
    },
    /// One positive number, or two: at the equator and at the poles.
    ByLatitude,
    /// One word of a list.
    Word(&'static [&'static str]),
}

/// The value of an option.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum OptionValue {
    /// A whole number.
    Whole(u64),
    /// A number.
    Number(f64),
    /// Values at the equator and at the poles.
    ByLatitude([f32; 2]),
    /// A word.
    Word(String),
}

impl OptionValues {
    /// Returns the text for help.
    pub fn text(&self) -> String {
        match self {
            Self::Whole { least, most } if *most == u64::MAX => {
                format!("a whole number, {least} at least")
            }
            Self::Whole { least, most } => format!("a whole number, {least} to {most}"),
            Self::Number { least, most } => format!("a number, {least} to {most}"),
            Self::ByLatitude => "one or two positive numbers such as 2e-4 or 1e-4,2e-4".to_owned(),
            Self::Word(words) => words.join(" or "),
        }
    }

    fn parse(&self, text: &str) -> Option<OptionValue> {
        match self {
            Self::Whole { least, most } => {
                let value = text.parse().ok()?;
                (*least..=*most)
                    .contains(&value)
                    .then_some(OptionValue::Whole(value))
            }
            Self::Number { least, most } => {
                let value = text.parse().ok()?;
                // Never true of NaN.
                (*least..=*most)
                    .contains(&value)
                    .then_some(OptionValue::Number(value))
            }
            Self::ByLatitude => {
                let (equator, pole) = text.split_once(',').unwrap_or((text, text));
                let values = [equator.parse().ok()?, pole.parse().ok()?];
                let is_usable = |value: &f32| *value > 0.0 && value.is_finite();
                values
                    .iter()
                    .all(is_usable)
                    .then_some(OptionValue::ByLatitude(values))
            }
            Self::Word(words) => words
                .contains(&text)
                .then(|| OptionValue::Word(text.to_owned())),
        }
    }
}

impl std::fmt::Display for OptionValue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Whole(value) => write!(f, "{value}"),
            Self::Number(value) => write!(f, "{value}"),
            Self::ByLatitude([equator, pole]) => write!(f, "{equator},{pole}"),
            Self::Word(word) => f.write_str(word),
        }
    }
}

impl MethodOption {
    /// Returns a constant that is a number of the range `[least, most]`.
    pub const fn number(
        (id, doc): (&'static str, &'static str),
        [least, most]: [f64; 2],
        default: &'static str,
        constant: Constant,
    ) -> Self {
        Self {
            id,
            doc,
            values: OptionValues::Number { least, most },
            default,
            constant: Some(constant),
            cpu_only: &[],
        }
    }

    /// Returns a constant of a component that is one of some words, the form of an equation for example. The first
    /// word is the default.
    pub const fn form(
        (id, doc): (&'static str, &'static str),
        words: &'static [&'static str],
        source: &'static str,
        component: &'static str,
    ) -> Self {
        Self {
            id,
            doc,
            values: OptionValues::Word(words),
            default: words[0],
            constant: Some(Constant {
                unit: "",
                source,
                component: Some(component),
                is_weight: false,
            }),
            cpu_only: &[],
        }
    }
}

/// Maximum number of Gaussians.
pub const MAX_GAUSSIANS: MethodOption = MethodOption {
    id: "max-gaussians",
    doc: "never more Gaussians than this; more points are thinned out",
    values: OptionValues::Whole {
        least: 1,
        most: u64::MAX,
    },
    default: "half the pixels of a view",
    constant: None,
    cpu_only: &[],
};
/// Number of shards that train one after another.
pub const SHARDS: MethodOption = MethodOption {
    id: "shards",
    doc: "into how many shards Gaussians are cut, of which one after another learns from a drawing of all; 1 for \
          all at once",
    values: OptionValues::Whole {
        least: 1,
        most: 4096,
    },
    default: "as few as fit into memory",
    constant: None,
    cpu_only: &[],
};
/// Degree of the spherical harmonics of colour.
pub const SH_DEGREE: MethodOption = MethodOption {
    id: "sh-degree",
    doc: "degree of the spherical harmonics of colour",
    values: OptionValues::Whole {
        least: 0,
        most: MAX_SH_DEGREE as u64,
    },
    default: "0, or what the scene gives reason for",
    constant: None,
    cpu_only: &[],
};
/// Definition of a Gaussian's falloff in a pixel.
pub const FOOTPRINT: MethodOption = MethodOption {
    id: "footprint",
    doc: "footprint of a Gaussian: linearized at its centre, or its largest value along the pixel's \
          ray",
    values: OptionValues::Word(&["projected", "ray"]),
    default: "projected",
    constant: None,
    cpu_only: &[],
};
/// Image gradient from which Gaussians are cloned or split.
pub const DENSIFY_THRESHOLD: MethodOption = MethodOption {
    id: "densify-threshold",
    doc: "image gradient from which Gaussians are cloned or split; two values are those at the \
          equator and at the poles",
    values: OptionValues::ByLatitude,
    default: "that of the method",
    constant: None,
    cpu_only: &[],
};

/// Options of all methods whose model is Gaussians.
pub const OF_GAUSSIANS: &[MethodOption] = &[MAX_GAUSSIANS, SH_DEGREE, FOOTPRINT, DENSIFY_THRESHOLD];

/// Requested values of a method's own options, by name.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Options(BTreeMap<&'static str, OptionValue>);

impl Options {
    /// Reads `NAME=VALUE` lines against a method's declarations.
    ///
    /// # Errors
    /// When the method does not have an option, a value is not allowed, or an option is given twice.
    pub fn parse(
        method: &str,
        declared: &'static [MethodOption],
        lines: &[String],
    ) -> Result<Self, ReconstructError> {
        let refuse = |reason: String| ReconstructError::Request { reason };
        let mut options = Self::default();
        for line in lines {
            let (name, text) = line
                .split_once('=')
                .ok_or_else(|| refuse(format!("{line:?}: expected an option as NAME=VALUE")))?;
            let kind = format!("{method} option");
            let option = names::find(&kind, name, declared, |option| option.id)?;
            let value = option.values.parse(text).ok_or_else(|| {
                refuse(format!("{name}: {text:?} is not {}", option.values.text()))
            })?;
            if options.0.insert(option.id, value).is_some() {
                return Err(refuse(format!("{name}: is given twice")));
            }
        }
        Ok(options)
    }

    /// Returns options with this maximum number of Gaussians.
    pub fn at_most(gaussians: u64) -> Self {
        Self([(MAX_GAUSSIANS.id, OptionValue::Whole(gaussians))].into())
    }

    /// Returns options with training in so many shards.
    pub fn in_shards(shards: u64) -> Self {
        Self([(SHARDS.id, OptionValue::Whole(shards))].into())
    }

    /// Returns options with spherical harmonics of this degree.
    pub fn of_sh_degree(degree: usize) -> Self {
        Self([(SH_DEGREE.id, OptionValue::Whole(degree as u64))].into())
    }

    /// Returns the names of the requested options.
    pub fn names(&self) -> impl Iterator<Item = &'static str> + '_ {
        self.0.keys().copied()
    }

    /// Returns the value of an option that is a word.
    pub fn word(&self, option: &MethodOption) -> Option<&str> {
        match self.0.get(option.id) {
            Some(OptionValue::Word(word)) => Some(word),
            _ => None,
        }
    }

    /// Returns the value of an option that is a whole number.
    pub fn whole(&self, option: &MethodOption) -> Option<u64> {
        match self.0.get(option.id) {
            Some(OptionValue::Whole(value)) => Some(*value),
            _ => None,
        }
    }

    /// Returns the value of an option that is a number.
    pub fn number(&self, option: &MethodOption) -> Option<f32> {
        match self.0.get(option.id) {
            Some(OptionValue::Number(value)) => Some(*value as f32),
            _ => None,
        }
    }

    /// Returns the constants among a method's options that have other values than by default.
    #[must_use]
    pub fn changed_constants(&self, declared: &[MethodOption]) -> Self {
        let is_changed = |id: &str, value: &OptionValue| {
            let mut constants = declared.iter().filter(|option| option.constant.is_some());
            let option = constants.find(|option| option.id == id);
            option.is_some_and(|option| option.values.parse(option.default).as_ref() != Some(value))
        };
        let values = self.0.iter();
        let changed = values.filter(|(id, value)| is_changed(id, value));
        Self(changed.map(|(id, value)| (*id, value.clone())).collect())
    }

    /// Returns the lines that [`Options::parse`] reads.
    pub fn lines(&self) -> impl Iterator<Item = String> + '_ {
        self.0.iter().map(|(id, value)| format!("{id}={value}"))
    }

    /// Returns [`MAX_GAUSSIANS`].
    pub fn maximum_gaussians(&self) -> Option<u64> {
        self.whole(&MAX_GAUSSIANS)
    }

    /// Returns [`SHARDS`].
    pub fn shards(&self) -> Option<usize> {
        self.whole(&SHARDS).map(|shards| shards as usize)
    }

    /// Returns [`SH_DEGREE`].
    pub fn sh_degree(&self) -> Option<usize> {
        self.whole(&SH_DEGREE).map(|degree| degree as usize)
    }

    /// Returns [`DENSIFY_THRESHOLD`] at the equator and at the poles.
    pub fn densify_threshold(&self) -> Option<[f32; 2]> {
        match self.0.get(DENSIFY_THRESHOLD.id) {
            Some(OptionValue::ByLatitude(values)) => Some(*values),
            _ => None,
        }
    }

    /// Returns [`FOOTPRINT`].
    pub fn footprint(&self) -> Footprint {
        match self.0.get(FOOTPRINT.id) {
            Some(OptionValue::Word(word)) if word == "ray" => Footprint::Ray,
            _ => Footprint::Projected,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(lines: &[&str]) -> Result<Options, String> {
        let lines: Vec<String> = lines.iter().map(|&line| line.to_owned()).collect();
        Options::parse("odgs", OF_GAUSSIANS, &lines).map_err(|error| error.to_string())
    }

    #[test]
    fn values_are_read_as_declared() {
        let options = parse(&[
            "max-gaussians=500",
            "sh-degree=2",
            "footprint=ray",
            "densify-threshold=1e-4,2e-4",
        ])
        .expect("good options");
        assert_eq!(options.maximum_gaussians(), Some(500));
        assert_eq!(options.sh_degree(), Some(2));
        assert_eq!(options.footprint(), Footprint::Ray);
        assert_eq!(options.densify_threshold(), Some([1e-4, 2e-4]));
        let none = Options::default();
        assert_eq!((none.maximum_gaussians(), none.sh_degree()), (None, None));
        assert_eq!(none.footprint(), Footprint::Projected);
    }

    #[test]
    fn what_a_method_does_not_declare_is_refused_in_one_line() {
        for (lines, expected) in [
            (
                &["sh-degree=4"][..],
                "sh-degree: \"4\" is not a whole number, 0 to 3",
            ),
            (&["max-gaussians=0"], "is not a whole number, 1 at least"),
            (
                &["densify-threshold=-1"],
                "is not one or two positive numbers",
            ),
            (
                &["densify-threshold=inf"],
                "is not one or two positive numbers",
            ),
            (&["footprint=round"], "is not projected or ray"),
            (&["footprint"], "expected an option as NAME=VALUE"),
            (&["sh-degree=1", "sh-degree=1"], "is given twice"),
            (
                &["sh-dgree=1"],
                "there is no odgs option \"sh-dgree\"; known: max-gaussians, sh-degree, footprint, \
                 densify-threshold; did you mean \"sh-degree\"?",
            ),
        ] {
            let message = parse(lines).expect_err("refused");
            assert!(message.contains(expected), "{message}");
        }
    }
    const WEIGHTS: &[MethodOption] = &[
        MAX_GAUSSIANS,
        MethodOption::number(
            ("loss-weight", "weight of a loss"),
            [0.0, 10.0],
            "0.01",
            Constant {
                unit: "of the photometric loss",
                source: "Eq. 1",
                component: Some("loss"),
                is_weight: true,
            },
        ),
        MethodOption::form(
            ("loss-form", "form of a loss"),
            &["sum", "mean"],
            "Eq. 1",
            "loss",
        ),
    ];

    #[test]
    fn constants_with_their_default_values_are_no_change() {
        let parse = |lines: &[&str]| {
            let lines: Vec<String> = lines.iter().map(|&line| line.to_owned()).collect();
            Options::parse("odgs", WEIGHTS, &lines).map_err(|error| error.to_string())
        };
        for (lines, changed) in [
            (
                &["loss-weight=0.5", "max-gaussians=7"][..],
                &["loss-weight=0.5"][..],
            ),
            (&["loss-weight=1e-2", "loss-form=mean"], &["loss-form=mean"]),
            (&["loss-form=sum"], &[]),
        ] {
            let options = parse(lines).expect("good options");
            let found: Vec<String> = options.changed_constants(WEIGHTS).lines().collect();
            assert_eq!(found, changed);
        }
        let options = parse(&["loss-weight=0.5"]).expect("good options");
        assert_eq!(options.number(&WEIGHTS[1]), Some(0.5));
        assert_eq!(options.number(&MAX_GAUSSIANS), None);
        for value in ["-1", "11", "NaN", "inf", "much"] {
            let message = parse(&[&format!("loss-weight={value}")]).expect_err("refused");
            assert!(message.contains("is not a number, 0 to 10"), "{message}");
        }
    }
}
