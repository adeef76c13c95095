//! The forms that a report is printed in, and the trajectories that it gives away.

use super::inputs::Inputs;
use super::outputs;
use crate::report::{Case, Report, Run, chain, export, json, tables, terminal};
use crate::stream::{Encoding, Fault, Options, Output, Role};
use std::path::PathBuf;

/// In which form the report is printed, and what else it writes.
#[derive(Clone, Debug, clap::Args)]
pub struct FormArgs {
    /// Print JSON in place of the table
    #[arg(long, group = "form")]
    pub json: bool,
    /// Print every number as CSV: run,zone,axis,statistic,value
    #[arg(long, group = "form")]
    pub csv: bool,
    /// Print the errors, the runs side by side and where they come from in Markdown
    #[arg(long, group = "form")]
    pub markdown: bool,
    /// Print the errors and the runs side by side in LaTeX (package booktabs)
    #[arg(long, group = "form")]
    pub latex: bool,
    /// Write the runs as they were compared (aligned, without the delay, where that is asked for) and
    /// the reference to DIR/NAME.tum or .euroc, for other kits
    #[arg(long, num_args = 2, value_names = ["FORMAT", "DIR"])]
    pub export: Vec<String>,
}

/// Where an export goes.
pub(super) struct Export {
    encoding: Encoding,
    ending: String,
    folder: PathBuf,
    runs: Vec<Run>,
}

impl FormArgs {
    /// The report in the form asked for.
    pub(super) fn text(
        &self,
        report: &Report,
        style: terminal::Style,
        options: &Options,
    ) -> anyhow::Result<String> {
        Ok(if self.json {
            json::write(report)?
        } else if self.csv {
            tables::csv(report)?
        } else if self.markdown {
            tables::markdown(report)
        } else if self.latex {
            tables::latex(report)
        } else {
            let mut text = terminal::write(report, style);
            if options.verbose > 0 {
                text.push_str("where it comes from\n");
                for line in chain::lines(report) {
                    text.push_str(&format!("  {line}\n"));
                }
            }
            text
        })
    }

    /// What is to be exported, with the runs as they were read.
    pub(super) fn exports(&self, inputs: &Inputs) -> Result<Vec<Export>, Fault> {
        let wanted = self.export.chunks(2).filter_map(|pair| match pair {
            [format, folder] => Some((format, folder)),
            _ => None,
        });
        wanted
            .map(|(format, folder)| {
                let encoding = match format.as_str() {
                    "tum" => Encoding::Tum,
                    "euroc" => Encoding::Euroc,
                    _ => {
                        let why = format!("--export {format}: tum or euroc is wanted");
                        return Err(Fault::Usage(why));
                    }
                };
                Ok(Export {
                    encoding,
                    ending: format.clone(),
                    folder: PathBuf::from(folder),
                    runs: inputs.runs.clone(),
                })
            })
            .collect()
    }
}

impl Export {
    /// Writes the runs, and the reference's `points`.
    pub(super) fn write(
        &self,
        cases: &[Case],
        points: &[crate::record::TrajectoryPoint],
        role: Role,
        options: &Options,
    ) -> anyhow::Result<()> {
        outputs::folder(&self.folder)?;
        let reference = if role == Role::Truth {
            "truth"
        } else {
            "desired"
        };
        let mut output = self.create(reference, options)?;
        for point in points {
            output.write_trajectory(role, point)?;
        }
        output.finish_kind::<crate::record::TrajectoryPoint>()?;
        for run in &self.runs {
            let Some(case) = cases.iter().find(|case| case.run == run.name) else {
                continue;
            };
            let name = match export::file_name(&run.name) {
                // The reference has that name already.
                name if name == reference => format!("{name} 2"),
                name => name,
            };
            let mut output = self.create(&name, options)?;
            for pose in export::placed(run, case) {
                output.write(&pose)?;
            }
            output.finish_kind::<crate::record::Pose>()?;
        }
        Ok(())
    }

    fn create(&self, name: &str, options: &Options) -> anyhow::Result<Output> {
        let path = self.folder.join(format!("{name}.{}", self.ending));
        Output::create(&path, self.encoding, options)
    }
}
