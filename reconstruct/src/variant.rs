//! Names of a method with other components or constants than its own: `odgs-without-short-schedule`, which has the
//! published rates, `omni4dgs-without-aids`, `omni4dgs-plan-auto`, `omni4dgs-set-gamma=1`.
//!
//! Tables show them in place of the method's name, so that every row has an exact name.

use crate::registry::find;
use omnilife_training::{
    components::aids,
    error::ReconstructError,
    method::Method,
    options::Options,
    request::{BackendChoice, DefaultPlan, MethodRequest, PlanChoice},
};

const WITH: &str = "-with-";
const WITHOUT: &str = "-without-";
const PLAN: &str = "-plan-";
const SET: &str = "-set-";

/// A method with its requested components.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    /// Id of the method.
    pub method: &'static str,
    /// Components to use.
    pub with: Vec<String>,
    /// Components to leave out.
    pub without: Vec<String>,
    /// Plan of the other components; `None` is the method's own.
    pub plan: Option<PlanChoice>,
    /// Constants of its publication with other values than by default.
    pub constants: Options,
}

impl Variant {
    /// Returns the variant of a request.
    pub fn of(method: &Method, request: &MethodRequest) -> Self {
        let sorted = |names: &[String]| {
            let mut names = names.to_vec();
            names.sort();
            names.dedup();
            names
        };
        let by_default = request.plan == PlanChoice::from(method.default_plan);
        Self {
            method: method.id,
            with: sorted(&request.with),
            without: sorted(&request.without),
            plan: (!by_default).then(|| request.plan.clone()),
            constants: request.options.changed_constants(method.options),
        }
    }

    /// Reads a name: that of a method, and behind it any number of `-with-COMPONENT`, `-without-COMPONENT`,
    /// `-set-CONSTANT=VALUE`, and `-plan-auto` or `-plan-full`.
    ///
    /// # Errors
    /// When the method does not exist, or lacks a component or a constant, or a value is not allowed.
    pub fn parse(name: &str) -> Result<Self, ReconstructError> {
        let (id, mut rest) = name.split_at(next_mark(name));
        let method = find(id)?;
        let mut variant = Self {
            method: method.id,
            with: Vec::new(),
            without: Vec::new(),
            plan: None,
            constants: Options::default(),
        };
        let mut set = Vec::new();
        while let Some((mark, behind)) = mark_of(rest) {
            let (word, following) = behind.split_at(next_mark(behind));
            match mark {
                WITH => variant.with.push(word.to_owned()),
                WITHOUT => variant.without.push(word.to_owned()),
                SET => set.push(word.to_owned()),
                _ => variant.plan = Some(plan(name, word)?.into()),
            }
            rest = following;
        }
        variant.constants = Options::parse(method.id, method.options, &set)?;
        refuse_others(method, &variant.constants)?;
        let request = variant.request(1, 0);
        method.check(&request, BackendChoice::Cpu)?;
        // One name for one variant: results are identified by it.
        Ok(Self::of(method, &request))
    }

    /// Returns the same variant without any aid; `None` for a method that cannot have one.
    ///
    /// # Errors
    /// When the method does not exist.
    pub fn bare(&self) -> Result<Option<Self>, ReconstructError> {
        let supported = find(self.method)?.supported();
        let mut bare = self.clone();
        bare.forget_aids();
        bare.without.push(aids::ALL.to_owned());
        bare.without.sort();
        Ok(supported.aids().next().map(|_| bare))
    }

    /// Returns the same variant with all aids that the method can have, by the evidence; `None` for a method without
    /// optional ones that the evidence decides on.
    ///
    /// # Errors
    /// When the method does not exist.
    pub fn aided(&self) -> Result<Option<Self>, ReconstructError> {
        let mut optional = find(self.method)?.optional_components.iter();
        let mut aided = self.clone();
        aided.forget_aids();
        aided.with.push(aids::ALL.to_owned());
        aided.with.sort();
        let is_decided = |name: &&str| aids::is_aid(name) && !aids::BY_NAME.contains(name);
        Ok(optional.any(is_decided).then_some(aided))
    }

    fn forget_aids(&mut self) {
        let is_other = |name: &String| !aids::is_aid(name) && name != aids::ALL;
        self.with.retain(is_other);
        self.without.retain(is_other);
    }

    /// Returns its request.
    pub fn request(&self, iterations: u64, seed: u64) -> MethodRequest {
        let plan =
            || find(self.method).map_or(PlanChoice::Auto, |method| method.default_plan.into());
        MethodRequest {
            with: self.with.clone(),
            without: self.without.clone(),
            plan: self.plan.clone().unwrap_or_else(plan),
            options: self.constants.clone(),
            ..MethodRequest::new(iterations, seed)
        }
    }
}

impl std::fmt::Display for Variant {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.method)?;
        match &self.plan {
            None => {}
            Some(PlanChoice::Auto) => f.write_str("-plan-auto")?,
            Some(PlanChoice::Full) => f.write_str("-plan-full")?,
            Some(PlanChoice::Only(names)) => write!(f, "-plan-{}", names.join("-"))?,
        }
        for name in &self.with {
            write!(f, "{WITH}{name}")?;
        }
        for name in &self.without {
            write!(f, "{WITHOUT}{name}")?;
        }
        for line in self.constants.lines() {
            write!(f, "{SET}{line}")?;
        }
        Ok(())
    }
}

/// Refuses options that are not constants of a publication: results of one name may differ in them.
fn refuse_others(method: &Method, options: &Options) -> Result<(), ReconstructError> {
    let mut declared = method.options.iter();
    let other = declared
        .find(|option| option.constant.is_none() && options.names().any(|name| name == option.id));
    match other {
        None => Ok(()),
        Some(option) => Err(ReconstructError::Request {
            reason: format!(
                "{}: the option {} stands in no name of a method; give it with --set",
                method.id, option.id
            ),
        }),
    }
}

/// Returns the position of the next mark of a text, or its length.
fn next_mark(text: &str) -> usize {
    let marks = [WITH, WITHOUT, PLAN, SET];
    let found = marks.iter().filter_map(|mark| text.find(mark)).min();
    found.unwrap_or(text.len())
}

/// Returns the mark at the start of a text, and the rest.
fn mark_of(text: &str) -> Option<(&'static str, &str)> {
    [WITH, WITHOUT, PLAN, SET]
        .into_iter()
        .find_map(|mark| Some((mark, text.strip_prefix(mark)?)))
}

fn plan(name: &str, word: &str) -> Result<DefaultPlan, ReconstructError> {
    match word {
        "auto" => Ok(DefaultPlan::Auto),
        "full" => Ok(DefaultPlan::Full),
        _ => Err(ReconstructError::Request {
            reason: format!("{name}: a plan in a method's name is auto or full, not {word}"),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registry::METHODS;

    #[test]
    fn names_say_what_is_asked_and_are_read_back() {
        for name in [
            "odgs",
            "omni4dgs-plus",
            "odgs-with-dropout",
            "odgs-without-short-schedule",
            "omni4dgs-with-aids",
            "omni4dgs-without-aids",
            "omni4dgs-plan-auto-with-mask-seeds-with-static-table",
            "omni4dgs-plus-plan-full-without-mask-seeds",
            "periodic-without-temporal-density",
            "omni4dgs-with-velocity-decomposition-set-gamma=0.25-set-velocity-form=literal",
            "panogs-with-scaffold-set-scaffold-weight=10",
        ] {
            let variant = Variant::parse(name).expect(name);
            assert_eq!(variant.to_string(), name);
            let method = find(variant.method).expect("a method");
            assert_eq!(Variant::of(method, &variant.request(600, 3)), variant);
        }
        // Values by default make no variant, however they are written.
        let usual = Variant::parse("omni4dgs-set-gamma=5e-1-set-motion-form=seen");
        assert_eq!(usual.expect("a name").to_string(), "omni4dgs");
        // One name for one variant, in any order of its parts.
        let other = Variant::parse("omni4dgs-with-static-table-plan-full-with-mask-seeds");
        let name = other.map(|variant| variant.to_string());
        assert_eq!(
            name.ok().as_deref(),
            Some("omni4dgs-with-mask-seeds-with-static-table")
        );
    }

    #[test]
    fn a_variant_has_a_bare_and_an_aided_one_beside_it() {
        for (name, bare, aided) in [
            ("odgs", Some("odgs-without-aids"), Some("odgs-with-aids")),
            (
                "odgs-with-dropout-without-sky-shell",
                Some("odgs-without-aids-without-sky-shell"),
                Some("odgs-with-aids-without-sky-shell"),
            ),
            ("omni4dgs-plus", Some("omni4dgs-plus-without-aids"), None),
            ("odgs-published", None, None),
            ("nearest-input", None, None),
        ] {
            let variant = Variant::parse(name).expect(name);
            let beside = [variant.bare(), variant.aided()];
            let names = beside.map(|found| found.expect(name).map(|other| other.to_string()));
            assert_eq!(names, [bare, aided].map(|name| name.map(str::to_owned)));
            for name in names.iter().flatten() {
                let read = Variant::parse(name).map(|variant| variant.to_string());
                assert_eq!(read.ok().as_ref(), Some(name));
            }
        }
    }

    #[test]
    fn what_no_method_has_is_refused() {
        for (name, said) in [
            ("odg", "odg"),
            ("odgs-with-masks", "masks"),
            ("odgs-without-", "odgs component"),
            ("odgs-plan-half", "auto or full"),
            ("omni4dgs-set-gamma=much", "is not a number, 0 to 8"),
            ("omni4dgs-set-gama=1", "did you mean \"gamma\"?"),
            ("odgs-set-max-gaussians=7", "give it with --set"),
            ("odgs-published-without-aids", "aids"),
            (
                "odgs-with-sky-shell-without-sky-shell",
                "asked for and left out",
            ),
        ] {
            let error = Variant::parse(name).expect_err(name).to_string();
            assert!(error.contains(said), "{name}: {error}");
        }
    }

    #[test]
    fn no_name_of_a_method_reads_as_a_variant() {
        for method in METHODS {
            let all = [method.components, method.optional_components].concat();
            let options: Vec<&str> = method.options.iter().map(|option| option.id).collect();
            let all = [&all[..], &options[..]].concat();
            for mark in [WITH, WITHOUT, PLAN, SET] {
                let holds = |name: &str| format!("-{name}-").contains(mark);
                assert!(!holds(method.id) && !all.iter().any(|name| holds(name)));
            }
        }
    }
}
