//! All commands that write, with their prerequisites; tests walk the list.

use std::{
    fs,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    sync::LazyLock,
};

use crate::support::{
    METHOD, SEQUENCE, SMALL, files, kept_folder, omnilife, sample, small_run, write_tracked_split,
};

/// Commands that print and write no files.
const WRITES_NOTHING: &[&str] = &[
    "bench compare",
    "bench diagnose",
    "bench list",
    "bench tracks",
    "bench validate",
    "bench video",
    "completions",
    "curate ledger agreement",
    "curate ledger export",
    "curate ledger show",
    "curate probe",
    "curate projection",
    "curate status",
    "curate verify",
    "doctor",
    "leaderboard datasets",
    "reconstruct backends",
    "reconstruct methods",
    "reconstruct plan",
    "sweep status",
];
/// Commands that write but are not walked, with the reason.
const ELSEWHERE: &[(&str, &str)] = &[
    (
        "bench stability",
        "takes minutes; writes as bench curve does",
    ),
    ("bench poses", "writes one file, where it is told to"),
    ("curate build", "is curate"),
    (
        "curate dense",
        "takes scenes of pinholes: the tests of dense stereo",
    ),
    (
        "curate operator",
        "writes as curate masks does, after seconds of looking: the tests of motion",
    ),
    ("leaderboard query", "writes one file, where it is told to"),
    ("reconstruct prepare", "is curate dense and curate tracks"),
    (
        "sweep plan commands",
        "writes as the other plans do; makes the sweep that is run",
    ),
    (
        "sweep retry",
        "needs a unit that has failed: the tests of sweeps",
    ),
    ("sweep submit", "needs Slurm: the tests of sweeps"),
];

pub(crate) struct WritingCommand {
    /// Its words, where `OUT` stands for its folder.
    pub(crate) words: Vec<String>,
    /// Folder that is copied to start from.
    pub(crate) copy_of: Option<PathBuf>,
    /// Exit code where the folder holds foreign files.
    pub(crate) code_among_foreign_files: i32,
}

impl WritingCommand {
    fn new(words: &str, code_among_foreign_files: i32) -> Self {
        let method = small_run().out.join(METHOD);
        let sequence = small_run().out.join(SEQUENCE);
        let places = [
            ("DATASET", small_run().out.clone()),
            ("SEQUENCE", sequence.clone()),
            ("SCENE", sequence.join("scene.json")),
            ("SPLIT", sequence.join("per-scene/split.json")),
            ("RUN", method.join("run")),
            ("VIDEO", sample("street.mp4")),
            ("POSES", sample("poses.json")),
        ];
        let fill = |word: &str| {
            let (name, rest) = word.split_once('/').unwrap_or((word, ""));
            match places.iter().find(|(place, _)| *place == name) {
                Some((_, path)) if rest.is_empty() => path.to_str().unwrap().to_owned(),
                Some((_, path)) => path.join(rest).to_str().unwrap().to_owned(),
                None => word.to_owned(),
            }
        };
        Self {
            words: words.split_whitespace().map(fill).collect(),
            copy_of: None,
            code_among_foreign_files,
        }
    }

    /// Makes a command that works on a folder of the sample's run.
    fn in_place(folder: &str, words: &str) -> Self {
        Self::copying(&small_run().out.join(folder), words)
    }

    /// Makes a command that works on a copy of this folder.
    fn copying(folder: &Path, words: &str) -> Self {
        Self {
            copy_of: Some(folder.to_owned()),
            ..Self::new(words, 0)
        }
    }

    /// Returns the words that name it, without its arguments.
    pub(crate) fn name(&self) -> String {
        let is_name = |word: &&String| word.chars().all(|letter| letter.is_ascii_lowercase());
        let most = if self.words[..2] == ["sweep", "plan"] || self.words[1] == "ledger" {
            3
        } else {
            2
        };
        let words: Vec<&str> = self
            .words
            .iter()
            .take(most)
            .take_while(is_name)
            .map(String::as_str)
            .collect();
        words.join(" ")
    }

    /// Returns its words without folders.
    pub(crate) fn shown(&self) -> String {
        let name = |word: &String| match Path::new(word) {
            path if path.is_absolute() => {
                let name = path.file_name().unwrap_or_default();
                name.to_string_lossy().into_owned()
            }
            _ => word.clone(),
        };
        self.words.iter().map(name).collect::<Vec<_>>().join(" ")
    }

    /// Returns the arguments of `omnilife`, with `--quiet`, for the folder `out`.
    pub(crate) fn arguments(&self, inputs: &Inputs, out: &Path) -> Vec<String> {
        let moved = inputs.file("moved.json");
        let fill = |word: &String| match word.as_str() {
            "MOVED" => moved.clone(),
            "OUT" => out.to_str().unwrap().to_owned(),
            word => word.strip_prefix("OUT/").map_or_else(
                || word.to_owned(),
                |rest| out.join(rest).to_str().unwrap().to_owned(),
            ),
        };
        let words = self.words.iter().map(fill);
        std::iter::once("--quiet".to_owned()).chain(words).collect()
    }
}

/// Inputs of several commands.
pub(crate) struct Inputs {
    folder: PathBuf,
}

static INPUTS: LazyLock<Inputs> = LazyLock::new(Inputs::make);

impl Inputs {
    /// Returns the inputs, which all tests read.
    pub(crate) fn prepare() -> &'static Self {
        &INPUTS
    }

    fn make() -> Self {
        let inputs = Self {
            folder: kept_folder(&std::env::temp_dir()),
        };
        // Other users read them too.
        fs::set_permissions(&inputs.folder, fs::Permissions::from_mode(0o755)).unwrap();
        let write = |name: &str, text: &str| fs::write(inputs.file(name), text).unwrap();
        write(
            "method.toml",
            "id = \"m\"\n[render]\ncommand = [\"true\"]\n\
             [predictions]\nnovel = \"{work}/{frame:06}.png\"\n",
        );
        write(
            "edit.toml",
            "[[edit]]\nkind = \"retime\"\nobject = \"background\"\nframes = 0\n",
        );
        write(
            "vehicles.toml",
            "[[edit]]\nkind = \"shift\"\nobject = \"1\"\nby = [0.1, 0, 0]\n\n[[edit]]\nkind = \"rotate\"\nobject = \"1\"\nturn = [0, 0, 10]\n\n[[edit]]\nkind = \"duplicate\"\nobject = \"1\"\n",
        );
        write("lines.txt", "true\ntrue\n");
        write("cuts.csv", "begin_seconds,end_seconds\n0.4,0.44\n");
        write(
            "card.toml",
            "method = \"odgs\"\ntitle = \"ODGS\"\nauthors = [\"A\"]\nlicence = \"MIT\"\nhardware = \"x\"\n",
        );
        let at = |name: &str| inputs.file(name);
        write_tracked_split(&inputs.folder.join("tracked"));
        for words in [
            format!(
                "reconstruct train SCENE --split {0}/split.json --method object-graph --iterations 2 --without aids \
                 --out {0}/run",
                at("tracked")
            ),
            format!(
                "reconstruct train SCENE --split SPLIT --iterations 10 --trace 5 --without aids --out {}",
                at("traced")
            ),
            format!(
                "bench score --scene SCENE --split SPLIT --run {}/run.json --out {}",
                at("traced"),
                at("traced-score")
            ),
            format!(
                "reconstruct train SCENE --split SPLIT --method nag --iterations 2 --set rays=64 --out {}",
                at("nag")
            ),
            format!(
                "curate export SEQUENCE --format colmap --out {}",
                at("colmap")
            ),
            format!(
                "leaderboard submit DATASET --card {} --out {}",
                at("card.toml"),
                at("submission")
            ),
            format!(
                "sweep plan commands {} --reduce true --out {}",
                at("lines.txt"),
                at("sweep")
            ),
        ] {
            omnilife(&WritingCommand::new(&words, 0).words).succeeded();
        }
        // Poses of the sample, without masks or points.
        let text = fs::read_to_string(sample("poses.json")).unwrap();
        let mut poses: serde_json::Value = serde_json::from_str(&text).unwrap();
        poses.as_object_mut().unwrap().remove("points");
        for frame in poses["frames"].as_array_mut().unwrap() {
            frame.as_object_mut().unwrap().remove("mask");
        }
        write("moved.json", &poses.to_string());
        inputs
    }

    /// Returns the path of one of them.
    pub(crate) fn file(&self, name: &str) -> String {
        self.folder.join(name).to_str().unwrap().to_owned()
    }

    /// Returns the commands whose words contain `OMNILIFE_ONLY`; without it, all.
    pub(crate) fn chosen_commands(&self) -> Vec<WritingCommand> {
        let mut commands = self.commands();
        if let Ok(only) = std::env::var("OMNILIFE_ONLY") {
            commands.retain(|command| command.words.join(" ").contains(&only));
        }
        commands
    }

    pub(crate) fn commands(&self) -> Vec<WritingCommand> {
        let extra = self.folder.display();
        // Rows of the trace at fixed iterations: their times differ between runs. Evidence for aids takes longer than
        // training, and writes nothing.
        let small = format!("{} --trace 10 --without aids", SMALL.join(" "));
        let new = |words: &str, code| WritingCommand::new(words, code);
        vec![
            // A dataset is made in a folder of its own.
            new(&format!("run VIDEO --poses POSES {small} --out OUT"), 2),
            new("curate VIDEO --criteria none --width 64 --out OUT", 2),
            new(
                "curate video VIDEO --criteria none --width 64 --folder OUT",
                2,
            ),
            new("curate export SEQUENCE --format colmap --out OUT", 2),
            new(
                &format!("curate import {extra}/colmap --format colmap --out OUT"),
                2,
            ),
            new(
                &format!("leaderboard submit DATASET --card {extra}/card.toml --out OUT"),
                2,
            ),
            WritingCommand::in_place(
                "",
                &format!("run VIDEO --poses POSES {small} --out OUT --iterations 20"),
            ),
            WritingCommand::in_place("", "curate publish OUT"),
            WritingCommand::in_place("", "curate annotate OUT"),
            WritingCommand::in_place("", "curate overview OUT"),
            WritingCommand::in_place(SEQUENCE, "curate poses OUT --poses POSES"),
            WritingCommand::in_place(SEQUENCE, "curate poses OUT --poses MOVED"),
            WritingCommand::in_place(SEQUENCE, "curate masks OUT --from OUT/masks"),
            WritingCommand::in_place(
                SEQUENCE,
                &format!(
                    "curate attach OUT --class mover={}",
                    sample("masks").display()
                ),
            ),
            new("curate slice VIDEO --end 0.5 --out OUT/slice.mp4", 0),
            new("curate boundaries VIDEO --signals OUT/signals.parquet", 0),
            new("bench split SCENE --out OUT/split.json", 0),
            new(
                "bench score --scene SCENE --split SPLIT --run RUN/run.json --out OUT",
                0,
            ),
            new(
                "bench score --scene SCENE --split SPLIT --novel-views RUN/predictions/novel --method m --out OUT",
                0,
            ),
            new(
                &format!(
                    "bench external {extra}/method.toml --scene SCENE --split SPLIT --out OUT --accept-failures"
                ),
                0,
            ),
            new(
                "bench failed m --scene SCENE --split SPLIT --reason no --out OUT",
                0,
            ),
            new(&format!("bench curve {extra}/traced-score --out OUT"), 0),
            new("bench adapter pvg --out OUT", 0),
            new(
                "bench run SCENE --methods nearest-input,cross-fade --protocols per-scene --out OUT",
                0,
            ),
            new(
                "bench ablate SCENE --method periodic --plan full --iterations 3 --trace 1 --out OUT",
                0,
            ),
            new(
                "reconstruct train SCENE --split SPLIT --iterations 5 --trace 2 --without aids --out OUT",
                0,
            ),
            new(
                "reconstruct train SCENE --split SPLIT --method cross-fade --out OUT",
                0,
            ),
            new(
                "reconstruct render RUN --poses SCENE --size 32x16 --out OUT",
                0,
            ),
            new("reconstruct export RUN --out OUT", 0),
            new(&format!("reconstruct atlas {extra}/nag --out OUT"), 0),
            new(
                &format!("reconstruct edit {extra}/nag --script {extra}/edit.toml --out OUT"),
                0,
            ),
            new(
                &format!(
                    "reconstruct train SCENE --split {extra}/tracked/split.json --method object-graph --iterations 5 \
                     --trace 2 --without aids --out OUT"
                ),
                0,
            ),
            new(
                &format!(
                    "reconstruct edit {extra}/tracked/run --script {extra}/vehicles.toml --out OUT"
                ),
                0,
            ),
            new("leaderboard build DATASET --out OUT", 0),
            new(
                &format!("leaderboard add {extra}/submission --results OUT"),
                0,
            ),
            new("sweep plan curate VIDEO --dataset OUT/dataset --out OUT", 0),
            new(
                "sweep plan bench SCENE --methods odgs --results OUT/results --out OUT",
                0,
            ),
            WritingCommand::in_place(
                "videos/street",
                "curate audit OUT --video VIDEO --out OUT/audit.html",
            ),
            new("curate tracks SEQUENCE --split SPLIT --out OUT", 0),
            WritingCommand::in_place(
                "videos/street",
                &format!(
                    "curate ledger merge OUT {extra}/cuts.csv --author kim --time 2026-01-01T00:00:00Z"
                ),
            ),
            new("curate select DATASET --count 1 --out OUT", 0),
            new("leaderboard gallery DATASET --out OUT/gallery", 0),
            new(
                "leaderboard figure DATASET --methods odgs --out OUT/figure",
                0,
            ),
            WritingCommand::copying(&self.folder.join("sweep"), "sweep run OUT"),
            WritingCommand::copying(&self.folder.join("sweep"), "sweep reduce OUT"),
        ]
    }
}

/// Copies the files of a folder.
pub(crate) fn copy(from: &Path, to: &Path) {
    for file in files(from) {
        let target = to.join(&file);
        fs::create_dir_all(target.parent().unwrap()).unwrap();
        fs::copy(from.join(&file), target).unwrap();
    }
}

/// The reference of the command line lists every command; a new one belongs into a list here.
#[test]
fn every_command_is_walked_or_writes_nothing() {
    let reference = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/cli.md");
    let reference = fs::read_to_string(reference).unwrap();
    let inputs = Inputs::prepare();
    let walked: Vec<String> = inputs.commands().iter().map(WritingCommand::name).collect();
    let is_known = |name: &str| {
        walked.iter().any(|walked| walked == name)
            || WRITES_NOTHING.contains(&name)
            || ELSEWHERE.iter().any(|(elsewhere, _)| *elsewhere == name)
    };
    let unknown: Vec<&str> = reference
        .lines()
        .filter_map(|line| line.strip_prefix("## `omnilife ")?.strip_suffix('`'))
        .filter(|name| !name.split(' ').any(|word| word == "help") && !is_known(name))
        .collect();
    assert!(
        unknown.is_empty(),
        "{unknown:?} are in no list of {}",
        file!()
    );
}
