//! `omnilife bench ablate`: contribution of each component of a method.
//!
//! It trains and scores, so it is here: `bench` knows no method.

use std::path::Path;

use omnilife_bench::{protocols, split_scene};
use omnilife_reconstruct::{
    jobs::plan_cost,
    methods::{self, Method},
    request::MethodRequest,
};
use omnilife_schemas::{
    ErrorKind,
    layout::SPLIT_FILE,
    progress::Progress,
    records::{ComponentDecision, ResultRecord, Scene},
    stage::StagePlan,
    store,
};
use omnilife_tracks::TrackOptions;

use super::pooled;
use crate::{
    cli::MethodArguments,
    exit::{self, BadRequest, PartialFailure},
    plans::{self, ablation},
    preparation,
};

/// Name of the table, in the folder of the runs.
const TABLE_FILE: &str = "ablation.md";

/// Runs every row, or takes it from the folder where its inputs are unchanged; prints the table. `of_paper`: the rows
/// are those of the ablation in the method's publication.
///
/// # Errors
/// When the method has no such component, its publication no ablation, or a run fails; the others are in the table.
pub(crate) fn execute(
    scene: &Path,
    out: &Path,
    protocol: &str,
    (arguments, iterations): (&MethodArguments, u64),
    of_paper: bool,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    let method = methods::find(&arguments.method)?;
    let arguments = if of_paper {
        with_ablated(method, arguments)?
    } else {
        arguments.clone()
    };
    let arguments = &arguments;
    // A faulty request must not be found out by every row.
    let asked = arguments.request(iterations)?;
    method.check(&asked, arguments.backend.into())?;
    protocols::protocol(protocol)?;
    store::read_record::<Scene>(scene)?;
    let summary = StagePlan::new(out, "ablation");
    let (table, failures, rows) =
        summary.run([TABLE_FILE], progress, |made| -> anyhow::Result<_> {
            let split = out.join(SPLIT_FILE);
            split_scene(scene, protocol, &split)?;
            let tracking = TrackOptions::default();
            preparation::prepare(&[method], scene, &split, &tracking, progress)?;
            let can_be_left_out = |component: &str| {
                let without = without(&asked, component);
                method.check(&without, arguments.backend.into()).is_ok()
            };
            let decisions = plan_cost::decisions(scene, &split, method, &asked)?;
            let is_in_question =
                |component: &str| !of_paper || method.ablation.contains(&component);
            let rows = rows(&decisions, |component| {
                is_in_question(component) && can_be_left_out(component)
            });
            if rows.len() == 1 {
                return Err(BadRequest(format!(
                    "{} uses no components on this scene that could be left out",
                    method.id
                ))
                .into());
            }
            let networks = plans::scoring_networks()?;
            let request = ablation::AblationRequest {
                scene,
                split: &split,
                out,
                arguments,
                iterations,
                networks: &networks,
                needs: pooled::needs(None)?,
            };
            let units = rows.iter().map(|row| request.unit(method, row.as_deref()));
            let units = units.collect::<anyhow::Result<_>>()?;
            let mut table = String::new();
            let mut failures = Vec::new();
            for (unit, state) in pooled::run_units(out, units, progress)? {
                if let Some((reason, blame)) = pooled::failure(&state) {
                    failures.push((unit.id, reason, blame));
                    continue;
                }
                for file in &unit.outputs {
                    let result: ResultRecord = store::read_record(Path::new(file))?;
                    if table.is_empty() {
                        table = header(method, &result);
                    }
                    table += &row(&result);
                }
            }
            for (name, reason, _) in &failures {
                table += &format!("\n{name} failed: {reason}\n");
            }
            made.write_bytes(TABLE_FILE, table.as_bytes())?;
            Ok((table, failures, rows.len()))
        })?;
    exit::print(&format!("{table}\n{}\n", out.join(TABLE_FILE).display()))?;
    as_result(&failures, rows)
}

/// Returns the arguments with all components of the ablation in the method's publication.
///
/// # Errors
/// When the publication has no ablation of components.
fn with_ablated(method: &Method, arguments: &MethodArguments) -> anyhow::Result<MethodArguments> {
    if method.ablation.is_empty() {
        return Err(BadRequest(format!(
            "{}: its publication has no ablation of components that are here; leave --paper out",
            method.id
        ))
        .into());
    }
    let mut arguments = arguments.clone();
    let is_given = |name: &str, names: &[String]| names.iter().any(|given| given == name);
    for &name in method.ablation {
        let is_decided = is_given(name, &arguments.with) || is_given(name, &arguments.without);
        if method.optional_components.contains(&name) && !is_decided {
            arguments.with.push(name.to_owned());
        }
    }
    Ok(arguments)
}

/// Returns a request without a component, which may be one that it asks for.
fn without(asked: &MethodRequest, component: &str) -> MethodRequest {
    let mut without = asked.clone();
    without.with.retain(|name| name != component);
    without.without.push(component.to_owned());
    without
}

fn as_result(failures: &[(String, String, ErrorKind)], rows: usize) -> anyhow::Result<()> {
    let Some((name, reason, _)) = failures.first() else {
        return Ok(());
    };
    let is_ours = |(_, _, blame): &(String, String, ErrorKind)| *blame == ErrorKind::Internal;
    Err(PartialFailure {
        message: format!(
            "{} of {rows} rows failed, the first: {name}: {reason}",
            failures.len()
        ),
        blame: if failures.iter().any(is_ours) {
            ErrorKind::Internal
        } else {
            ErrorKind::User
        },
    }
    .into())
}

/// Returns the rows: all components, then all but one of them. A decision for a single object, `flow:swan`, is left
/// out for all objects; components that cannot be left out, such as an object, have no row.
fn rows(
    decisions: &[ComponentDecision],
    can_be_left_out: impl Fn(&str) -> bool,
) -> Vec<Option<String>> {
    let mut rows = vec![None];
    for decision in decisions.iter().filter(|decision| decision.used) {
        let component = &decision.component;
        let component = component
            .split_once(':')
            .map_or(component.as_str(), |(component, _)| component);
        let row = Some(component.to_owned());
        if can_be_left_out(component) && !rows.contains(&row) {
            rows.push(row);
        }
    }
    rows
}

fn header(method: &Method, result: &ResultRecord) -> String {
    let (mut names, mut line) = (String::new(), String::new());
    for (view, scores) in [
        ("input", &result.input_views),
        ("novel", &result.novel_views),
    ] {
        for metric in scores.keys() {
            names += &format!(" {view} {metric} |");
            line += "---:|";
        }
    }
    let used = result.aids.iter().flatten().filter(|(_, used)| **used);
    let aids: Vec<&str> = used.map(|(aid, _)| aid.as_str()).collect();
    let aids = if aids.is_empty() {
        "none".to_owned()
    } else {
        aids.join(", ")
    };
    format!(
        "{} on {}, protocol {}, aids: {aids}\n\n| Components |{names} Primitives | Training, s |\n\
         |---|{line}---:|---:|\n",
        method.title, result.scene, result.protocol
    )
}

fn row(result: &ResultRecord) -> String {
    let scores: String = result
        .input_views
        .values()
        .chain(result.novel_views.values())
        .map(|summary| format!(" {:.4} |", summary.mean))
        .collect();
    format!(
        "| {} |{scores} {} | {:.1} |\n",
        result.method,
        result.primitives.unwrap_or_default(),
        result.training_seconds.unwrap_or_default()
    )
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct MethodLine {
        #[command(flatten)]
        method: MethodArguments,
    }

    /// Every component of the publication's ablation can be left out, those asked for by `--paper` too.
    #[test]
    fn components_that_are_asked_for_can_be_left_out() {
        let method = methods::find("omni4dgs").expect("a method");
        let line = MethodLine::try_parse_from(["omnilife", "--method", "omni4dgs"]);
        let arguments = line.expect("arguments").method;
        let arguments = with_ablated(method, &arguments).expect("an ablation");
        let asked = arguments.request(10).expect("a request");
        for component in method.ablation {
            let without = without(&asked, component);
            let checked = method.check(&without, arguments.backend.into());
            assert!(checked.is_ok(), "{component}: {checked:?}");
            assert!(!without.with.iter().any(|name| name == component));
        }
    }

    #[test]
    fn what_is_an_option_here_is_used_where_the_publication_ablates_it() {
        let arguments = |method: &str, without: &[&str]| {
            let words = ["omnilife", "--method", method];
            let without = without.iter().flat_map(|&name| ["--without", name]);
            MethodLine::try_parse_from(words.into_iter().chain(without))
                .expect("arguments")
                .method
        };
        let names = |method: &str, without: &[&str]| {
            let row = methods::find(method).expect("a method");
            let arguments = with_ablated(row, &arguments(method, without));
            arguments.map(|arguments| arguments.with)
        };
        assert_eq!(
            names("omni4dgs", &[]).expect("an ablation"),
            ["velocity-decomposition", "motion-regularization"]
        );
        assert_eq!(
            names("omni4dgs", &["velocity-decomposition"]).expect("an ablation"),
            ["motion-regularization"]
        );
        let refused = names("odgs", &[]).expect_err("no ablation").to_string();
        assert!(
            refused.contains("odgs: its publication has no ablation"),
            "{refused}"
        );
    }

    #[test]
    fn what_a_plan_uses_is_left_out_one_at_a_time() {
        let decision = |component: &str, used| ComponentDecision {
            component: component.to_owned(),
            used,
            reason: String::new(),
        };
        let plan = [
            decision("sky-shell", true),
            decision("opacity-reset", false),
            decision("temporal-motion", true),
        ];
        let expected = [None, Some("sky-shell"), Some("temporal-motion")];
        assert_eq!(
            rows(&plan, |_| true),
            expected.map(|name| name.map(str::to_owned))
        );
        assert_eq!(rows(&plan[1..2], |_| true), [None]);

        let of_objects = [
            decision("object:swan", true),
            decision("flow:swan", true),
            decision("flow:background", true),
            decision("mask-loss", true),
        ];
        let expected = [None, Some("flow"), Some("mask-loss")];
        assert_eq!(
            rows(&of_objects, |component| component != "object"),
            expected.map(|name| name.map(str::to_owned))
        );
    }
}
