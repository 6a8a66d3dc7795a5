//! List of the methods with their components and options, as text and as JSON.

use omnilife_leaderboard::{MethodDescription, OptionDescription};
use omnilife_reconstruct::{
    methods::{METHODS, Method},
    options::MethodOption,
    request::{BackendChoice, DefaultPlan},
};
use serde_json::{Value, json};

/// Returns a method's description, one fact per line.
pub(super) fn text(method: &Method) -> String {
    let mut text = format!(
        "{}\n  {}\n  {}\n  {}\n",
        method.id, method.title, method.source, method.description
    );
    text += &format!("  Backends: {}\n", backends(method).join(", "));
    for (label, components) in [
        ("Components", method.components),
        ("On request", method.optional_components),
        ("Ablation in its publication", method.ablation),
    ] {
        if !components.is_empty() {
            text += &format!("  {label}: {}\n", components.join(", "));
        }
    }
    let aids: Vec<&str> = method.supported().aids().collect();
    if !aids.is_empty() {
        text += &format!("  Aids among them: {}\n", aids.join(", "));
    }
    if !method.options.is_empty() {
        text += "  Options (--set NAME=VALUE):\n";
    }
    for option in method.options {
        text += &option_line(option);
    }
    text
}

fn option_line(option: &MethodOption) -> String {
    let source = option.constant.map_or_else(String::new, |constant| {
        let facts = [constant.unit, constant.source];
        let facts = facts.iter().filter(|fact| !fact.is_empty());
        let facts: Vec<&str> = facts.copied().collect();
        format!(" ({})", facts.join("; "))
    });
    format!(
        "    {}: {}; {} [default: {}]{source}\n",
        option.id,
        option.doc,
        option.values.text(),
        option.default
    )
}

/// Returns a method's facts for programs.
pub(super) fn record(method: &Method) -> Value {
    let option = |option: &MethodOption| {
        json!({
            "name": option.id,
            "description": option.doc,
            "values": option.values.text(),
            "default": option.default,
            "unit": option.constant.map(|constant| constant.unit),
            "source": option.constant.map(|constant| constant.source),
            "component": option.constant.and_then(|constant| constant.component),
            "is_weight": option.constant.is_some_and(|constant| constant.is_weight),
        })
    };
    let plan = match method.default_plan {
        DefaultPlan::Auto => "auto",
        DefaultPlan::Full => "full",
    };
    json!({
        "id": method.id,
        "title": method.title,
        "source": method.source,
        "description": method.description,
        "backends": backends(method),
        "components": method.components,
        "on_request": method.optional_components,
        "ablation": method.ablation,
        "aids": method.supported().aids().collect::<Vec<_>>(),
        "plan": plan,
        "options": method.options.iter().map(option).collect::<Vec<_>>(),
    })
}

/// Returns the descriptions of all methods, for the pages of a leaderboard.
pub(crate) fn descriptions() -> Vec<MethodDescription> {
    let owned =
        |names: &[&str]| -> Vec<String> { names.iter().map(|name| (*name).to_owned()).collect() };
    let option = |option: &MethodOption| OptionDescription {
        name: option.id.to_owned(),
        text: option.doc.to_owned(),
        values: option.values.text(),
        default: option.default.to_owned(),
    };
    let described = METHODS.iter().map(|method| MethodDescription {
        method: method.id.to_owned(),
        title: method.title.to_owned(),
        source: method.source.to_owned(),
        text: method.description.to_owned(),
        backends: owned(&backends(method)),
        components: owned(method.components),
        on_request: owned(method.optional_components),
        options: method.options.iter().map(option).collect(),
    });
    described.collect()
}

fn backends(method: &Method) -> Vec<&'static str> {
    let backends = method.backends.iter().map(|backend| match backend {
        BackendChoice::Cpu => "cpu",
        BackendChoice::Gpu => "gpu",
    });
    backends.collect()
}

#[cfg(test)]
mod tests {
    use omnilife_reconstruct::methods;

    use super::*;

    #[test]
    fn constants_are_listed_with_unit_range_and_source() {
        let method = methods::find("omni4dgs").expect("a method");
        let text = text(method);
        let line = text.lines().find(|line| line.starts_with("    cycle: "));
        let line = line.expect("the cycle");
        for fact in ["a number, 1 to ", "[default: 10]", "(frames; ", "Eq. 1"] {
            assert!(line.contains(fact), "{fact}: {line}");
        }
        let record = record(method);
        let options = record["options"].as_array().expect("options");
        assert_eq!(options.len(), method.options.len());
        let weight = options
            .iter()
            .find(|option| option["name"] == "motion-weight");
        let weight = weight.expect("a weight");
        assert_eq!(weight["component"], "motion-regularization");
        assert_eq!(weight["is_weight"], true);
        assert_eq!(weight["default"], "0.01");
        assert_eq!(record["ablation"][0], "temporal-opacity");
    }
}
