//! Files in the folder of a build: its own, out of date, and those of the user.

use std::fs;

use crate::{
    leaderboard::{Place, study},
    support::{summary, write},
};
use omnilife_leaderboard::{
    LeaderboardError, LeaderboardRequest, build_leaderboard, check_leaderboard,
};
use omnilife_schemas::{Classified, ErrorKind, store};

#[test]
fn check_finds_what_is_out_of_date() {
    let place = Place::with(&study());
    let page = place.request.out.with_file_name("README.md");
    let request = LeaderboardRequest {
        page: Some(page.clone()),
        ..place.request.clone()
    };
    let message = |request: &LeaderboardRequest| {
        let error = check_leaderboard(request).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User);
        error.to_string()
    };
    assert!(
        message(&request).contains("is missing; build again"),
        "{}",
        message(&request)
    );

    fs::write(&page, "# Page\n").unwrap();
    assert!(matches!(
        build_leaderboard(&request),
        Err(LeaderboardError::NoMarker { .. })
    ));
    fs::write(
        &page,
        "# Page\n\n<!-- leaderboard: begin -->\nold\n<!-- leaderboard: end -->\n\nAfter.\n",
    )
    .unwrap();
    build_leaderboard(&request).unwrap();
    let text = fs::read_to_string(&page).unwrap();
    assert!(
        text.contains("| market/seq-000 ") && text.ends_with("end -->\n\nAfter.\n"),
        "{text}"
    );
    assert!(!text.contains("old"), "{text}");
    check_leaderboard(&request).unwrap();

    fs::write(
        &page,
        text.replace("| market/seq-000 ", "| market/seq-009 "),
    )
    .unwrap();
    assert!(message(&request).contains("README.md: its table is not what the results give"));
    build_leaderboard(&request).unwrap();

    // A better score is a difference; so is a table of methods that are not there any more.
    let mut better = study().remove(0);
    better
        .novel_views
        .insert("psnr".to_owned(), summary(20.001, 12));
    write(&request.results, &better);
    assert!(message(&request).contains("results.parquet: is not what the results give"));
    build_leaderboard(&request).unwrap();
    check_leaderboard(&request).unwrap();
    for scene in ["market", "lake", "urban-street"] {
        for entry in fs::read_dir(request.results.join(scene)).unwrap() {
            for method in fs::read_dir(entry.unwrap().path()).unwrap() {
                let method = method.unwrap().path();
                let record = method.join("1/score/result.json");
                if fs::read_to_string(record).unwrap().contains("without-") {
                    fs::remove_dir_all(method).unwrap();
                }
            }
        }
    }
    assert!(check_leaderboard(&request).is_err());
}

#[test]
fn a_new_build_removes_its_old_files_and_no_others() {
    let place = Place::with(&study());
    place.build();
    let pages = || {
        let folder = fs::read_dir(place.request.out.join("site/scenes")).unwrap();
        folder.count()
    };
    assert_eq!(pages(), 4);
    let notes = place.request.out.join("site/scenes/notes.txt");
    fs::write(&notes, "mine").unwrap();
    fs::remove_dir_all(place.request.results.join("lake")).unwrap();
    place.build();
    assert_eq!(pages(), 4, "three pages and the notes");
    assert!(notes.exists());
}

/// Whatever the list says, nothing goes but unchanged files of an earlier build.
#[test]
#[cfg(unix)]
fn a_rewritten_list_removes_nothing_of_the_users() {
    let place = Place::with(&study());
    place.build();
    let out = &place.request.out;
    let outside = out.with_file_name("precious");
    for folder in [outside.clone(), out.join(".git"), out.join("src")] {
        fs::create_dir(&folder).unwrap();
        fs::write(folder.join("f"), "mine").unwrap();
    }
    std::os::unix::fs::symlink(&outside, out.join("link")).unwrap();
    fs::write(out.join("thesis.tex"), "mine, and changed since").unwrap();
    let mine = store::sha256_bytes(b"mine");
    let absolute = outside.join("f");
    let files = [
        "",
        "../precious/f",
        absolute.to_str().unwrap(),
        ".git",
        "src",
        "link/f",
        "thesis.tex",
    ]
    .map(|file| format!("{{\"file\": \"{file}\", \"sha256\": \"{mine}\"}}"));
    let list = format!(
        "{{\"schema\": \"omnilife/file-list/1\", \"files\": [{}]}}",
        files.join(", ")
    );
    let manifest = out.join(".omnilife-leaderboard.json");
    // Files of the build itself are no longer listed: the same content may stay.
    fs::write(&manifest, list).unwrap();
    place.build();
    for file in [".git/f", "src/f", "link/f", "thesis.tex"] {
        assert!(out.join(file).is_file(), "{file}");
    }
    assert!(absolute.is_file());
    assert!(!fs::read_to_string(manifest).unwrap().contains("thesis"));
}

#[test]
fn a_file_of_the_users_is_not_overwritten() {
    let place = Place::with(&study());
    fs::create_dir_all(&place.request.out).unwrap();
    let table = place.request.out.join("table.md");
    fs::write(&table, "my notes").unwrap();
    let message = build_leaderboard(&place.request).unwrap_err().to_string();
    assert!(message.contains("table.md: is in the way"), "{message}");
    assert_eq!(fs::read_to_string(&table).unwrap(), "my notes");
    assert_eq!(fs::read_dir(&place.request.out).unwrap().count(), 1);
}
