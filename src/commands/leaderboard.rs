//! `omnilife leaderboard`.

use omnilife_leaderboard::{LeaderboardRequest, build_leaderboard, check_leaderboard};

use crate::{cli::LeaderboardCommand, exit};

pub(crate) fn execute(command: &LeaderboardCommand) -> anyhow::Result<()> {
    let LeaderboardCommand::Build(arguments) = command;
    let request = LeaderboardRequest {
        results: arguments.results.clone(),
        out: arguments.out.clone(),
        dataset: arguments.dataset.clone(),
        page: arguments.page.clone(),
        site: !arguments.no_site,
        views: arguments.views,
    };
    if arguments.check {
        check_leaderboard(&request)?;
        return exit::print("The tables are what the results give.\n");
    }
    let built = build_leaderboard(&request)?;
    let site = built
        .site
        .map_or_else(String::new, |page| format!("\nSite: {}\n", page.display()));
    exit::print(&format!("{}{site}", built.markdown))
}
