//! `isolume cluster`: the job scripts that bake a store by many tasks.

use crate::bake::cluster::{ClusterTasks, check_options, quoted};
use crate::cli::args::transfer::{parse_bytes, parse_time};
use crate::cli::commands::bake::Bake;
use crate::cli::failure::{Failure, Outcome};
use crate::cli::present::console::Console;
use crate::cli::present::text;
use crate::error::{Error, Result};
use crate::export::atomic;
use crate::export::target::check_file;
use clap::Subcommand;
use serde_json::json;
use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

/// Write the script that bakes a store by many tasks of a cluster
///
/// The tasks fill one store on a file system that all nodes see, each its share (bake --chunks i/n), and need not talk. A last job
/// verifies it. A task that is killed, requeued or out of time goes on where it was; the bytes are those of a bake in one go.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume cluster slurm brain.nii.gz --tasks 16 -o brain.isolume --script brain.sh -- --isovalues 90,160
  bash brain.sh                                   (submits the tasks, and the job that verifies)
  isolume cluster snakemake scene.toml --tasks 8 -o scene.isolume --script Snakefile
  snakemake --cores 8                             (here, or with the executor of a cluster)")]
pub(in crate::cli) struct Cluster {
    #[command(subcommand)]
    system: System,
}

#[derive(Subcommand)]
enum System {
    /// A job array of Slurm, and the job that waits for it and verifies
    ///
    /// The script is for sbatch, and submits itself and the verification when it is run by hand. $ISOLUME names the program, where it is
    /// not in $PATH of the nodes. Near the limit of time (--signal) a task stops when the chunks in work are written, and queues again.
    Slurm(Job),
    /// A workflow for Snakemake: a rule for the shares, and one that verifies
    Snakemake(Job),
}

#[derive(clap::Args)]
struct Job {
    /// Volume file, a field such as gyroid:128, an implicit model or a scene (.toml), as the nodes see it
    #[arg(value_name = "VOLUME|SCENE")]
    input: String,
    /// How many tasks, up to 4096; where there is less work than tasks some have nothing to do
    #[arg(short, long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    tasks: u32,
    /// The store, as the nodes see it
    #[arg(short, long, value_name = "X.isolume")]
    output: PathBuf,
    /// Where to write the script [default: standard output]
    #[arg(long, value_name = "FILE")]
    script: Option<PathBuf>,
    /// Each task bakes a store of its own, X-shares/i.isolume, which the last job merges: where nodes share no file system with locks
    #[arg(long)]
    apart: bool,
    /// Cores of a task
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=4096))]
    cpus: u32,
    /// Memory of a task, such as 24GB [default: about what the bake needs on --cpus threads, and a quarter more]
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes)]
    memory: Option<u64>,
    /// Limit of time of a task, such as 90m
    #[arg(long, value_name = "TIME", value_parser = parse_time, default_value = "2h")]
    limit: Duration,
    /// Partition of the cluster
    #[arg(long, value_name = "NAME")]
    partition: Option<String>,
    /// Options of bake, the same for all tasks
    #[arg(last = true, value_name = "OPTIONS OF BAKE")]
    bake: Vec<String>,
}

/// The bake that a line asks for, if it asks for one.
pub(in crate::cli) type BakeOf = dyn Fn(Vec<OsString>) -> Result<std::result::Result<Option<Box<Bake>>, clap::Error>>;

impl Cluster {
    pub(in crate::cli) fn run(&self, seed: u64, bake_of: &BakeOf, console: &Console) -> Outcome {
        let (System::Slurm(job) | System::Snakemake(job)) = &self.system;
        let bake = job.parsed(bake_of)?;
        let memory = match job.memory {
            Some(memory) => memory,
            None => bake.bytes_needed(seed, job.cpus as usize)? / 4 * 5,
        };
        // A node has more than the program: libraries, the kernel's pages of files.
        let mebibytes = memory.div_ceil(1 << 20).max(512);
        let seed = if seed == 0 { Vec::new() } else { vec!["--seed".to_owned(), seed.to_string()] };
        let tasks = ClusterTasks {
            input: job.input.clone(),
            tasks: job.tasks,
            output: job.output.clone(),
            apart: job.apart,
            cpus: job.cpus,
            mebibytes,
            limit: job.limit,
            partition: job.partition.clone(),
            options: job.bake.iter().cloned().chain(seed).collect(),
        };
        let script = match &self.system {
            System::Slurm(_) => tasks.slurm(),
            System::Snakemake(_) => tasks.snakemake(),
        };
        let Some(path) = &job.script else {
            console.print_raw(script.as_bytes());
            return Ok(());
        };
        check_file(path)?;
        atomic::write_bytes(path, script.as_bytes())?;
        let with = match &self.system {
            System::Slurm(_) => "submit them with: bash",
            System::Snakemake(_) => "run them with: snakemake -s",
        };
        let next = format!("{} tasks; {with} {}", job.tasks, quoted(&path.display().to_string()));
        console.summary(text::file_line(path, &next));
        console.print_json(&json!({ "script": path, "tasks": job.tasks, "memory_bytes": mebibytes << 20 }));
        Ok(())
    }
}

impl Job {
    /// The bake that all tasks do, read as a task will read it.
    fn parsed(&self, bake_of: &BakeOf) -> Outcome<Box<Bake>> {
        check_options(&self.bake)?;
        let line = ["isolume", "bake", &self.input, "-o", &self.output.to_string_lossy(), "--chunks", "1/1"];
        let line: Vec<OsString> =
            line.into_iter().chain(self.bake.iter().map(String::as_str)).map(OsString::from).collect();
        match bake_of(line)? {
            Ok(Some(bake)) => Ok(bake),
            Ok(None) => Err(Failure::Message("the options after -- are no options of bake".into())),
            Err(error) => {
                let text = error.to_string();
                let reason = text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned();
                let remedy = "give what `isolume bake --help` lists";
                Err(Error::argument("options of bake", self.bake.join(" "), reason, remedy).into())
            }
        }
    }
}
