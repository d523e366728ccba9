//! `isolume cluster`: the job scripts that bake a store by many tasks.

use super::bake::Bake;
use super::console::Console;
use super::options::{parse_bytes, parse_time};
use super::{Cli, Command, Failure, Outcome, scene, text};
use crate::error::Error;
use crate::export::atomic;
use crate::export::target::{check_file, clean};
use clap::Subcommand;
use serde_json::json;
use std::ffi::OsString;
use std::io::Write;
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
pub(super) struct Cluster {
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
    /// Memory of a task, such as 24GB [default: what the bake needs at most, and a quarter more]
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

/// Options of bake that a task must not have, and why.
const REFUSED: [(&str, &str); 9] = [
    ("--chunks", "each task gets its own"),
    ("--threads", "give --cpus"),
    ("--output", "give -o before the --"),
    ("-o", "give -o before the --"),
    ("--time", "tasks on other machines would decide otherwise: give --error or --rays"),
    ("--auto", "tasks on other machines would decide otherwise: give --error or --rays"),
    ("--force", "each task would replace what the others bake: remove the store first"),
    ("--replay-texel", "it bakes nothing"),
    ("--compress", "pack the store when all tasks are done: isolume pack"),
];

impl Cluster {
    pub(super) fn run(&self, seed: u64, console: &Console) -> Outcome {
        let (System::Slurm(job) | System::Snakemake(job)) = &self.system;
        let bake = job.parsed()?;
        let memory = match job.memory {
            Some(memory) => memory,
            None => bake.bytes_needed(seed)? / 4 * 5,
        };
        // A node has more than the program: libraries, the kernel's pages of files.
        let mebibytes = memory.div_ceil(1 << 20).max(512);
        let seed = if seed == 0 { Vec::new() } else { vec!["--seed".to_owned(), seed.to_string()] };
        let options: Vec<String> = job.bake.iter().cloned().chain(seed).collect();
        let script = match &self.system {
            System::Slurm(_) => job.slurm(mebibytes, &options),
            System::Snakemake(_) => job.snakemake(mebibytes, &options),
        };
        let Some(path) = &job.script else {
            console.print_raw(script.as_bytes());
            return Ok(());
        };
        check_file(path)?;
        atomic::write(path, |out| out.write_all(script.as_bytes()).map_err(|e| Error::io(path, "write", e)))?;
        let next = match &self.system {
            System::Slurm(_) => {
                format!("{} tasks; submit them with: bash {}", job.tasks, quoted(&path.display().to_string()))
            }
            System::Snakemake(_) => {
                format!("{} tasks; run them with: snakemake -s {}", job.tasks, quoted(&path.display().to_string()))
            }
        };
        console.summary(text::file_line(path, &next));
        console.print_json(&json!({ "script": path, "tasks": job.tasks, "memory_bytes": mebibytes << 20 }));
        Ok(())
    }
}

impl Job {
    /// The bake that all tasks do, read as a task will read it.
    fn parsed(&self) -> Outcome<Box<Bake>> {
        for word in &self.bake {
            let name = word.split_once('=').map_or(word.as_str(), |(name, _)| name);
            if let Some((option, why)) = REFUSED.iter().find(|(option, _)| *option == name) {
                return Err(Error::argument("options of bake", option, "those that all tasks share", *why).into());
            }
        }
        let line = ["isolume", "bake", &self.input, "-o", &self.output.to_string_lossy(), "--chunks", "1/1"];
        let line: Vec<OsString> =
            line.into_iter().chain(self.bake.iter().map(String::as_str)).map(OsString::from).collect();
        match scene::parse(line)? {
            Ok(Cli { command: Command::Bake(bake), .. }) => Ok(bake),
            Ok(_) => Err(Failure::Message("the options after -- are no options of bake".into())),
            Err(error) => {
                let text = error.to_string();
                let reason = text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned();
                let remedy = "give what `isolume bake --help` lists";
                Err(Error::argument("options of bake", self.bake.join(" "), reason, remedy).into())
            }
        }
    }

    /// The command of a task, with the names of shell variables in it, and the one that ends the work.
    fn commands(&self, options: &[String], index: &str, cores: &str) -> (String, String) {
        let store = quoted(&self.output.to_string_lossy());
        let shares = quoted(&format!("{}-shares", self.output.with_extension("").display()));
        let target = if self.apart { format!("{shares}/{index}.isolume") } else { store.clone() };
        let options: String = options.iter().map(|word| format!(" {}", quoted(word))).collect();
        let n = self.tasks;
        let bake = format!("bake {}{options} --chunks {index}/{n} --threads {cores} -o {target}", quoted(&self.input));
        let last = if self.apart {
            let all = (1..=n).map(|i| format!(" {shares}/{i}.isolume")).collect::<String>();
            format!("merge{all} -o {store}")
        } else {
            String::new()
        };
        (bake, last)
    }

    fn name(&self) -> String {
        let stem = self.output.file_stem().map_or_else(|| "store".into(), |stem| stem.to_string_lossy().into_owned());
        format!("isolume-{}", clean(&stem))
    }

    fn slurm(&self, mebibytes: u64, options: &[String]) -> String {
        let (bake, merge) = self.commands(options, "\"$SLURM_ARRAY_TASK_ID\"", "\"$SLURM_CPUS_PER_TASK\"");
        let (name, minutes) = (self.name(), self.limit.as_secs().div_ceil(60).max(1));
        let partition = self.partition.iter().map(|p| format!("#SBATCH --partition={p}\n")).collect::<String>();
        let folder = match self.apart {
            true => format!("mkdir -p {}\n", quoted(&format!("{}-shares", self.output.with_extension("").display()))),
            false => String::new(),
        };
        let merge = if merge.is_empty() { merge } else { format!("  \"$isolume\" {merge}\n") };
        format!(
            r#"#!/bin/bash
#SBATCH --job-name={name}
#SBATCH --array=1-{tasks}
#SBATCH --cpus-per-task={cpus}
#SBATCH --mem={mebibytes}M
#SBATCH --time={minutes}
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --signal=B:USR1@{notice}
#SBATCH --output={name}-%A_%a.log
{partition}# Bakes {store} by {tasks} tasks, each a share of the work, and verifies it.
# Run it by hand (bash SCRIPT) to submit the tasks and the job that verifies; what is there already is kept, so the same command
# completes a store after a failure. The number of tasks is part of what a share is: a task alone is submitted with
# sbatch --array=I SCRIPT.
set -eu
isolume="${{ISOLUME:-isolume}}"

if [ "${{1:-}}" = verify ]; then
{merge}  exec "$isolume" verify --complete {store}
fi

if [ -z "${{SLURM_ARRAY_TASK_ID:-}}" ]; then
  tasks="$(sbatch --parsable "$0")"
  last="$(sbatch --parsable --array=0 --time={minutes} --dependency="afterok:${{tasks%%;*}}" --kill-on-invalid-dep=yes \
    --job-name={name}-verify --output={name}-verify-%A.log "$0" verify)"
  echo "tasks ${{tasks%%;*}}, verification ${{last%%;*}}"
  exit
fi

# Slurm counts the restarts of a task; ids of tasks begin at 1, as shares do.
{folder}again=0
"$isolume" {bake} &
bake=$!
# The limit of time is near: the bake stops when the chunks in work are written, and the task queues again.
trap 'again=1; kill -TERM "$bake" 2>/dev/null || true' USR1
# Preemption, requeue, scancel: Slurm decides what comes of the task.
trap 'kill -TERM "$bake" 2>/dev/null || true' TERM INT
code=0
wait "$bake" || code=$?
# A signal ends the first wait, not the bake.
while kill -0 "$bake" 2>/dev/null; do
  code=0
  wait "$bake" || code=$?
done
if [ "$again" = 1 ] && [ "$code" = 143 ]; then
  scontrol requeue "${{SLURM_ARRAY_JOB_ID}}_${{SLURM_ARRAY_TASK_ID}}"
fi
exit "$code"
"#,
            // Of a short limit not more than a quarter.
            notice = (self.limit.as_secs() / 4).clamp(10, 120),
            tasks = self.tasks,
            cpus = self.cpus,
            store = quoted(&self.output.to_string_lossy()),
        )
    }

    fn snakemake(&self, mebibytes: u64, options: &[String]) -> String {
        let (bake, merge) = self.commands(options, "@share@", "@threads@");
        // Braces are Snakemake's own.
        let shell = |command: &str| {
            let text = format!("${{{{ISOLUME:-isolume}}}} {}", command.replace('{', "{{").replace('}', "}}"));
            let text = text.replace("@share@", "{wildcards.share}").replace("@threads@", "{threads}");
            serde_json::Value::from(text).to_string()
        };
        let store = self.output.to_string_lossy();
        let base = self.output.with_extension("");
        let done = |what: &str| serde_json::Value::from(format!("{}-shares/{what}", base.display())).to_string();
        let mut last = vec![format!("verify --complete {}", quoted(&store))];
        if !merge.is_empty() {
            last.insert(0, merge);
        }
        let last = last.iter().map(|command| shell(command)).collect::<Vec<_>>().join("\n        \" && \"\n        ");
        let minutes = self.limit.as_secs().div_ceil(60).max(1);
        format!(
            r#"# Bakes {store} by {tasks} tasks, each a share of the work, and verifies it. A task that was stopped goes on where it was.
rule verify:
    input: expand({shares}, share=range(1, {tasks} + 1))
    output: touch({verified})
    shell:
        {last}

rule share:
    output: touch({share})
    threads: {cpus}
    retries: 3
    resources:
        mem_mb={mebibytes},
        runtime={minutes},
    shell:
        {bake}
"#,
            tasks = self.tasks,
            cpus = self.cpus,
            shares = done("{share}.done"),
            share = done("{share}.done"),
            verified = done("verified"),
            bake = shell(&bake),
        )
    }
}

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./,:=+%@".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.into()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    fn job(line: &[&str]) -> (bool, Job) {
        let cli = Cli::parse_from([&["isolume", "cluster"], line].concat());
        match cli.command {
            Command::Cluster(Cluster { system: System::Slurm(job) }) => (true, job),
            Command::Cluster(Cluster { system: System::Snakemake(job) }) => (false, job),
            _ => panic!("no cluster"),
        }
    }

    #[test]
    fn words_are_quoted_where_a_shell_would_take_them_apart() {
        assert_eq!(quoted("a/b-c.nii.gz"), "a/b-c.nii.gz");
        assert_eq!(quoted("it's $HOME"), r"'it'\''s $HOME'");
        assert_eq!(quoted(""), "''");
    }

    #[test]
    fn tasks_share_the_options_and_have_a_share_each() {
        let (_, job) = job(&["slurm", "my brain.nii", "--tasks", "16", "-o", "b.isolume", "--", "--isovalues", "90"]);
        let script = job.slurm(1000, &job.bake);
        let task = r#"bake 'my brain.nii' --isovalues 90 --chunks "$SLURM_ARRAY_TASK_ID"/16 --threads "$SLURM_CPUS_PER_TASK" -o b.isolume"#;
        assert!(script.contains(task), "{script}");
        assert!(
            script.contains("#SBATCH --array=1-16\n") && script.contains("verify --complete b.isolume"),
            "{script}"
        );
        assert!(!script.contains("merge"));
    }

    #[test]
    fn stores_of_their_own_are_merged_at_the_end() {
        let (_, job) = job(&["slurm", "gyroid:32", "--tasks", "2", "-o", "g.isolume", "--apart"]);
        let script = job.slurm(1000, &job.bake);
        assert!(script.contains("merge g-shares/1.isolume g-shares/2.isolume -o g.isolume"), "{script}");
        assert!(
            script.contains("mkdir -p g-shares") && script.contains("-o g-shares/\"$SLURM_ARRAY_TASK_ID\".isolume")
        );
    }

    #[test]
    fn a_workflow_has_a_rule_for_the_shares_and_one_that_verifies() {
        let (slurm, job) = job(&["snakemake", "gyroid:32", "--tasks", "3", "-o", "g.isolume", "--", "--rays", "16"]);
        let file = job.snakemake(512, &job.bake);
        assert!(!slurm && file.contains("range(1, 3 + 1)"), "{file}");
        assert!(
            file.contains("bake gyroid:32 --rays 16 --chunks {wildcards.share}/3 --threads {threads} -o g.isolume")
        );
    }

    #[test]
    fn what_tasks_cannot_share_is_refused_by_name() {
        for (option, word) in [("--force", "replace"), ("--time=2m", "--error"), ("--chunks", "own")] {
            let (_, job) = job(&["slurm", "gyroid:32", "--tasks", "2", "-o", "g.isolume", "--", option]);
            let text = job.parsed().map(drop).unwrap_err().to_string();
            assert!(text.contains(word), "{text}");
        }
        let (_, job) = job(&["slurm", "gyroid:32", "--tasks", "2", "-o", "g.isolume", "--", "--isovales=2"]);
        assert!(job.parsed().map(drop).unwrap_err().to_string().contains("bake --help"));
    }
}
