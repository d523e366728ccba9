//! What a bake will take and give, as a table.

use crate::cli::present::text;
use crate::study::forecast::Weighed;
use crate::study::model::Forecast;

/// All forecasts from 16 to 4096 rays, the chosen one marked.
pub(in crate::cli) fn table(all: &[Weighed], chosen: Option<(f64, u32)>, threads: usize) -> String {
    let mut lines =
        vec![["texture", "rays", "time", "error", "of it floor", "texels", "size", ""].map(String::from).to_vec()];
    for weighed in all {
        for rays in (4..=12).step_by(2).map(|k| 1u32 << k) {
            let forecast = weighed.pilot.forecast(rays);
            lines.push(line(weighed, &forecast, threads, chosen == Some((weighed.ratio, rays))));
        }
        if let Some((ratio, rays)) = chosen
            && ratio == weighed.ratio
            && (rays.trailing_zeros() % 2 == 1 || !(16..=4096).contains(&rays))
        {
            lines.push(line(weighed, &weighed.pilot.forecast(rays), threads, true));
        }
    }
    text::table(&lines)
}

fn line(weighed: &Weighed, forecast: &Forecast, threads: usize, is_chosen: bool) -> Vec<String> {
    vec![
        weighed.ratio.to_string(),
        forecast.rays.to_string(),
        text::duration(std::time::Duration::from_secs_f64(forecast.seconds / threads as f64)),
        text::percent(forecast.error),
        text::percent(weighed.pilot.accuracy.floor.sqrt()),
        text::count(weighed.pilot.texels),
        text::bytes(weighed.bytes as f64),
        if is_chosen { "chosen".into() } else { String::new() },
    ]
}
