//! The job scripts by which many tasks of a cluster bake one store.

use crate::error::{Error, Result};
use crate::file::clean;
use std::path::PathBuf;
use std::time::Duration;

/// The tasks that bake a store, each its share.
#[derive(Clone, Debug)]
pub struct ClusterTasks {
    /// The volume or scene, as the nodes see it.
    pub input: String,
    /// How many tasks.
    pub tasks: u32,
    /// The store, as the nodes see it.
    pub output: PathBuf,
    /// Whether each task bakes a store of its own, which the last job merges.
    pub apart: bool,
    /// Cores of a task.
    pub cpus: u32,
    /// Memory of a task.
    pub mebibytes: u64,
    /// Limit of time of a task.
    pub limit: Duration,
    /// Partition of the cluster.
    pub partition: Option<String>,
    /// Options of `isolume bake`, the same for all tasks.
    pub options: Vec<String>,
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

/// Refuses options of `isolume bake` that a task must not have.
///
/// # Errors
/// Names the option, and why.
pub fn check_options(options: &[String]) -> Result<()> {
    for word in options {
        let name = word.split_once('=').map_or(word.as_str(), |(name, _)| name);
        if let Some((option, why)) = REFUSED.iter().find(|(option, _)| *option == name) {
            return Err(Error::argument("options of bake", option, "those that all tasks share", *why));
        }
    }
    Ok(())
}

impl ClusterTasks {
    /// The command of a task, with the names of shell variables in it, and the one that ends the work.
    fn commands(&self, index: &str, cores: &str) -> (String, String) {
        let store = quoted(&self.output.to_string_lossy());
        let shares = quoted(&format!("{}-shares", self.output.with_extension("").display()));
        let target = if self.apart { format!("{shares}/{index}.isolume") } else { store.clone() };
        let options: String = self.options.iter().map(|word| format!(" {}", quoted(word))).collect();
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

    /// A job array of Slurm, which submits itself and the job that verifies.
    pub fn slurm(&self) -> String {
        let (bake, merge) = self.commands("\"$SLURM_ARRAY_TASK_ID\"", "\"$SLURM_CPUS_PER_TASK\"");
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
            mebibytes = self.mebibytes,
            tasks = self.tasks,
            cpus = self.cpus,
            store = quoted(&self.output.to_string_lossy()),
        )
    }

    /// A workflow of Snakemake.
    pub fn snakemake(&self) -> String {
        let (bake, merge) = self.commands("@share@", "@threads@");
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
            mebibytes = self.mebibytes,
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
pub fn quoted(word: &str) -> String {
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

    fn tasks(input: &str, tasks: u32, output: &str, options: &[&str]) -> ClusterTasks {
        ClusterTasks {
            input: input.into(),
            tasks,
            output: output.into(),
            apart: false,
            cpus: 4,
            mebibytes: 1000,
            limit: Duration::from_secs(7200),
            partition: None,
            options: options.iter().map(|o| (*o).to_string()).collect(),
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
        let script = tasks("my brain.nii", 16, "b.isolume", &["--isovalues", "90"]).slurm();
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
        let script = ClusterTasks { apart: true, ..tasks("gyroid:32", 2, "g.isolume", &[]) }.slurm();
        assert!(script.contains("merge g-shares/1.isolume g-shares/2.isolume -o g.isolume"), "{script}");
        assert!(
            script.contains("mkdir -p g-shares") && script.contains("-o g-shares/\"$SLURM_ARRAY_TASK_ID\".isolume")
        );
    }

    #[test]
    fn a_workflow_has_a_rule_for_the_shares_and_one_that_verifies() {
        let file = tasks("gyroid:32", 3, "g.isolume", &["--rays", "16"]).snakemake();
        assert!(file.contains("range(1, 3 + 1)"), "{file}");
        assert!(
            file.contains("bake gyroid:32 --rays 16 --chunks {wildcards.share}/3 --threads {threads} -o g.isolume")
        );
    }
}
