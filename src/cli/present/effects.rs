//! The plan of effects as a table.

use crate::cli::present::text;
use crate::scene;

/// The plan as a table.
pub(in crate::cli) fn table(plan: &scene::Plan) -> String {
    let header = ["effect", "", "cost", "setting, reason, and error of what is dropped"].map(String::from).to_vec();
    let mut rows = vec![header];
    for effect in &plan.effects {
        let kind = if effect.estimated { "estimate" } else { "bound" };
        rows.push(vec![
            effect.name.into(),
            if effect.on { "on" } else { "off" }.into(),
            if effect.cost_share > 0.0 { format!("{:.0} %", 100.0 * effect.cost_share) } else { "-".into() },
            match effect.error {
                Some(error) => {
                    format!("{}: {}; error {} ({kind})", effect.setting, effect.reason, text::percent(error))
                }
                None => format!("{}: {}", effect.setting, effect.reason),
            },
        ]);
    }
    text::table(&rows)
}
