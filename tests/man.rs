//! The man pages in `man/` say what `--help` says. They are rendered here from the tools' own
//! `Args`; `make man` (`UPDATE_MAN=1 cargo test --test man`) rewrites them.

use cablepose::tool;
use clap::{Command, CommandFactory};
use clap_mangen::Man;
use clap_mangen::roff::{Roff, bold, roman};
use std::fs;
use std::path::{Path, PathBuf};

/// The exit statuses in a page, in the words of `stream::exit`.
const STATUSES: &[(u8, &str)] = &[
    (0, "Done; also when the reader of standard output left."),
    (2, "The command line makes no sense."),
    (
        3,
        "Done, but records were lost or skipped, or none could be solved; standard error counts them.",
    ),
    (4, "A gate of --fail-if failed."),
    (65, "Bad data; the message names file, line and column."),
    (66, "An input that cannot be opened."),
    (69, "A device or server is not available."),
    (74, "Reading or writing failed, a full disk included."),
    (
        78,
        "A configuration that makes no sense; the message names the key.",
    ),
];

/// A tool's page.
struct Page {
    command: Command,
    statuses: &'static [u8],
    see_also: &'static [&'static str],
}

impl Page {
    fn of<A: CommandFactory>(statuses: &'static [u8], see_also: &'static [&'static str]) -> Page {
        Page {
            command: A::command(),
            statuses,
            see_also,
        }
    }

    /// The page of a subcommand: `timesync fit` is in `timesync-fit.1`.
    fn of_subcommand<A: CommandFactory>(name: &str, statuses: &'static [u8]) -> Page {
        let whole = A::command();
        let tool = whole.get_name().to_owned();
        let part = whole.find_subcommand(name).unwrap().clone();
        let command = part
            .bin_name(format!("{tool} {name}"))
            .version(env!("CARGO_PKG_VERSION"))
            .name(&*format!("{tool}-{name}").leak());
        Page {
            command,
            statuses,
            see_also: &[],
        }
    }

    fn name(&self) -> &str {
        self.command.get_name()
    }

    /// Whether it is a tool of its own.
    fn is_tool(&self) -> bool {
        self.command
            .get_bin_name()
            .is_none_or(|name| !name.contains(' '))
    }

    fn render(&self) -> String {
        let man = Man::new(self.command.clone());
        // Not Man::render_title: it drops the empty date, and what follows moves up one place.
        let mut text = format!(
            ".TH \"{}\" \"1\" \"\" \"cablepose {}\" \"cablepose\"\n",
            self.name(),
            self.command.get_version().unwrap_or_default()
        )
        .into_bytes();
        man.render_name_section(&mut text).unwrap();
        man.render_synopsis_section(&mut text).unwrap();
        man.render_description_section(&mut text).unwrap();
        man.render_options_section(&mut text).unwrap();
        let mut roff = Roff::new();
        if let Some(more) = self.command.get_after_long_help() {
            more_sections(&more.to_string(), &mut roff);
        }
        self.closing_sections(&mut roff);
        roff.to_writer(&mut text).unwrap();
        tidy(&String::from_utf8(text).unwrap())
    }

    fn closing_sections(&self, roff: &mut Roff) {
        let more = self.command.get_after_long_help();
        if !more.is_some_and(|more| more.to_string().contains("\nEXIT STATUS\n")) {
            roff.control("SH", ["EXIT STATUS"]);
            for (status, meaning) in STATUSES {
                if self.statuses.contains(status) {
                    roff.control("TP", []);
                    roff.text([bold(status.to_string())]);
                    roff.text([roman(*meaning)]);
                }
            }
        }
        roff.control("SH", ["SEE ALSO"]);
        let mut others = vec!["cablepose(7)".to_owned()];
        others.extend(self.see_also.iter().map(|name| format!("{name}(1)")));
        roff.text([roman(others.join(", "))]);
    }
}

/// `after_long_help` as sections: a line that is all capitals opens one, lines indented by four or
/// more are shown as they are, the rest is running text whose paragraphs end with an empty line, a
/// heading or an example.
fn more_sections(text: &str, roff: &mut Roff) {
    let mut verbatim = false;
    let mut in_paragraph = false;
    for line in text.lines() {
        let as_it_is = line.starts_with("    ");
        if as_it_is != verbatim && !line.is_empty() {
            if as_it_is {
                roff.control("RS", []).control("nf", []);
            } else {
                roff.control("fi", []).control("RE", []);
            }
            verbatim = as_it_is;
        }
        if verbatim {
            roff.text([roman(line.strip_prefix("    ").unwrap_or(line))]);
        } else if is_heading(line) {
            roff.control("SH", [line]);
        } else if !line.is_empty() {
            if line.starts_with("  ") && !in_paragraph {
                roff.control("PP", []);
            }
            roff.text([roman(line.trim_start())]);
        }
        in_paragraph = !verbatim && !line.is_empty() && !is_heading(line);
    }
    if verbatim {
        roff.control("fi", []).control("RE", []);
    }
}

fn is_heading(line: &str) -> bool {
    line.starts_with(|c: char| c.is_ascii_uppercase())
        && line.chars().all(|c| c.is_ascii_uppercase() || c == ' ')
}

/// One apostrophe preamble at the top instead of one a section; no blank at the end of a line.
fn tidy(page: &str) -> String {
    const PREAMBLE: &str = ".ie \\n(.g .ds Aq \\(aq\n.el .ds Aq '\n";
    let mut out = PREAMBLE.to_owned();
    for line in page.replace(PREAMBLE, "").lines() {
        out.push_str(line.trim_end());
        out.push('\n');
    }
    out
}

const FILTER: &[u8] = &[0, 2, 3, 65, 66, 74, 78];

fn pages() -> Vec<Page> {
    vec![
        Page::of::<tool::scan_capture::Args>(
            &[0, 2, 3, 65, 66, 69, 74, 78],
            &["extract-lines", "timesync"],
        ),
        Page::of_subcommand::<tool::scan_capture::Args>("info", &[0, 2, 69]),
        Page::of_subcommand::<tool::scan_capture::Args>("list", &[0, 2, 69]),
        Page::of::<tool::imu_read::Args>(
            &[0, 2, 3, 65, 66, 69, 74, 78],
            &["solve-pose", "timesync"],
        ),
        Page::of_subcommand::<tool::imu_read::Args>("replay", &[0, 2, 3, 65, 66, 74, 78]),
        Page::of_subcommand::<tool::imu_read::Args>("info", &[0, 2, 69, 74]),
        Page::of_subcommand::<tool::imu_read::Args>("eeprom", &[0, 2, 69, 74]),
        Page::of_subcommand::<tool::imu_read::Args>("bias", &[0, 2, 69, 74]),
        Page::of_subcommand::<tool::imu_read::Args>("tare", &[0, 2, 69, 74]),
        Page::of_subcommand::<tool::imu_read::Args>("rate", &[0, 2, 69, 74]),
        Page::of_subcommand::<tool::imu_read::Args>("check", &[0, 2, 3, 65, 69, 74]),
        Page::of_subcommand::<tool::imu_read::Args>("list", &[0, 2, 69, 74]),
        Page::of::<tool::timesync::Args>(
            &[0, 2, 3, 65, 66, 69, 74, 78],
            &["scan-capture", "compensate-delay"],
        ),
        Page::of_subcommand::<tool::timesync::Args>("set", &[0, 2, 66, 69, 74, 78]),
        Page::of_subcommand::<tool::timesync::Args>("poll", &[0, 2, 3, 69, 74]),
        Page::of_subcommand::<tool::timesync::Args>("fit", &[0, 2, 3, 65, 66, 74]),
        Page::of_subcommand::<tool::timesync::Args>("watch", &[0, 2, 69, 74]),
        Page::of_subcommand::<tool::timesync::Args>("track", &[0, 2, 3, 65, 66, 74]),
        Page::of_subcommand::<tool::timesync::Args>("delay", &[0, 2, 3, 65, 66, 74]),
        Page::of_subcommand::<tool::timesync::Args>("ntp", &[0, 2, 66, 69, 74, 78]),
        Page::of::<tool::simulate::Args>(
            &[0, 2, 65, 66, 74, 78],
            &["extract-lines", "solve-pose", "report"],
        ),
        Page::of::<tool::extract_lines::Args>(FILTER, &["scan-capture", "simulate", "solve-pose"]),
        Page::of::<tool::solve_pose::Args>(FILTER, &["extract-lines", "imu-read", "report"]),
        Page::of::<tool::compensate_delay::Args>(
            FILTER,
            &["solve-pose", "timesync", "simulate", "ads-push"],
        ),
        Page::of::<tool::ads_push::Args>(
            &[0, 2, 3, 65, 66, 69, 74, 78],
            &["compensate-delay", "report"],
        ),
        Page::of_subcommand::<tool::ads_push::Args>("check", &[0, 2, 69, 74, 78]),
        Page::of_subcommand::<tool::ads_push::Args>("list", &[0, 2, 69, 74]),
        Page::of::<tool::report::Args>(&[0, 2, 3, 4, 65, 66, 74], &["solve-pose", "simulate"]),
        Page::of_subcommand::<tool::report::Args>("diff", &[0, 2, 4, 65, 66, 74]),
        Page::of_subcommand::<tool::report::Args>("convert", &[0, 2, 3, 65, 66, 74]),
        Page::of_subcommand::<tool::report::Args>("frame", &[0, 2, 4, 66, 74, 78]),
        Page::of_subcommand::<tool::report::Args>("scan", &[0, 2, 3, 65, 66, 74, 78]),
        Page::of_subcommand::<tool::report::Args>("static", &[0, 2, 3, 4, 65, 66, 74]),
    ]
}

fn man_dir() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("man")
}

#[test]
fn the_pages_say_what_the_help_says() {
    let update = std::env::var_os("UPDATE_MAN").is_some();
    let mut stale = Vec::new();
    for page in pages() {
        let path = man_dir().join(format!("{}.1", page.name()));
        let text = page.render();
        if update {
            fs::write(&path, &text).unwrap();
        } else if fs::read_to_string(&path).unwrap_or_default() != text {
            stale.push(path);
        }
    }
    assert!(stale.is_empty(), "stale, run `make man`: {stale:?}");
}

#[test]
fn every_tool_has_a_page_and_every_page_a_tool() {
    let mut tools: Vec<String> = fs::read_dir(man_dir().join("../src/bin"))
        .unwrap()
        .map(|entry| {
            entry
                .unwrap()
                .path()
                .file_stem()
                .unwrap()
                .to_string_lossy()
                .into_owned()
        })
        .collect();
    let pages = pages().into_iter().filter(Page::is_tool);
    let mut pages: Vec<String> = pages.map(|page| page.name().to_owned()).collect();
    tools.sort();
    pages.sort();
    assert_eq!(tools, pages);
}

#[test]
fn wrapped_lines_are_one_paragraph() {
    let mut roff = Roff::new();
    let text = "NOTES\n  one\n  two\n\n  three\n    as it is\n    too\n  four\n";
    more_sections(text, &mut roff);
    let page = tidy(&roff.render());
    let (_, body) = page.split_once(".SH NOTES\n").unwrap();
    assert_eq!(
        body,
        ".PP\none\ntwo\n.PP\nthree\n.RS\n.nf\nas it is\ntoo\n.fi\n.RE\n.PP\nfour\n"
    );
}

#[test]
fn the_overview_names_every_tool() {
    let overview = fs::read_to_string(man_dir().join("cablepose.7")).unwrap();
    for page in pages().iter().filter(|page| page.is_tool()) {
        let name = page.name().replace('-', "\\-");
        assert!(overview.contains(&name), "cablepose.7 does not name {name}");
    }
}
