//! `results.csv`: what was measured, for other programs.

use super::results::{Results, ViewErrors};
use super::subject::{Code, Memory};

impl Results {
    /// A table, a row for each configuration.
    pub fn csv(&self) -> String {
        const PER_VIEW: [&str; 9] = [
            "flip",
            "psnr_db",
            "depth_mean",
            "depth_p999",
            "normal_mean_degrees",
            "normal_p999_degrees",
            "reference_pixels",
            "silhouette_pixels",
            "missing_pixels",
        ];
        let names: Vec<&str> = self
            .configurations
            .first()
            .iter()
            .flat_map(|m| &m.views)
            .map(|view| view.view.as_str())
            .collect();
        let mut csv = "method,N,frame_ms,rays_per_second,preparation_ms,edit_ms,\
            bvh_bytes,tree_bytes,map_bytes,all_bytes,pipeline_instructions,pipeline_bytes,flicker,rounds"
            .to_owned();
        for view in &names {
            PER_VIEW.iter().for_each(|column| csv += &format!(",{view}_{column}"));
        }
        csv.push('\n');
        for m in &self.configurations {
            let n = m.configuration.n.map_or_else(String::new, |n| n.to_string());
            let Memory { bvh, trees, maps, all } = m.memory;
            let code = m.pipeline.map_or_else(
                || ",".to_owned(),
                |Code { instructions, bytes }| format!("{instructions},{bytes}"),
            );
            csv += &format!(
                "{},{n},{},{},{},{},{bvh},{trees},{maps},{all},{code},{},{}",
                m.configuration.method_name(),
                m.frame_ms,
                m.rays_per_second,
                m.preparation_ms,
                m.edit_ms,
                m.flicker,
                m.rounds.preparation_ms.len(),
            );
            for ViewErrors { errors, .. } in &m.views {
                let psnr = errors.psnr_db.map_or_else(|| "inf".to_owned(), |db| db.to_string());
                csv += &format!(
                    ",{},{psnr},{},{},{},{},{},{},{}",
                    errors.flip,
                    errors.depth_mean,
                    errors.depth_p999,
                    errors.normal_mean_degrees,
                    errors.normal_p999_degrees,
                    errors.reference_pixels,
                    errors.silhouette_pixels,
                    errors.missing_pixels
                );
            }
            csv.push('\n');
        }
        csv
    }
}
