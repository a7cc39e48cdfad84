//! The materials of a scene as the kernels read them: their colour maps' texels one map behind the other.

use crate::heights::{common, grown};
use crate::render::RenderError;
use crate::scene::Material;
use crate::scene::mip_levels;
use crate::settings::{Filter, Wrap};
use emboss_kernels::interface::{self, color_format, wrap};
use std::sync::Arc;

/// Packed materials.
#[derive(Clone, Debug, Default)]
pub struct Colors {
    /// One for each material.
    pub materials: Vec<interface::Material>,
    /// Texels of all maps.
    pub texels: Vec<u32>,
    /// What pipelines know of formats: that of all materials, or [`color_format::PER_MATERIAL`].
    pub format: u32,
    /// What they know of wraps: that of all maps, or [`wrap::PER_MAP`].
    pub wrap: u32,
}

impl Colors {
    /// Packs the colour maps of `materials`, each once however many share it. `usual_wrap` is that of materials that do
    /// not say theirs; `filter` is how all are read.
    ///
    /// # Errors
    /// [`RenderError::MapsTooLarge`] where they are more words than 32 bits can number.
    pub fn pack(materials: Vec<Material>, usual_wrap: Wrap, filter: Filter) -> Result<Colors, RenderError> {
        let mut packed: Vec<interface::Material> = Vec::with_capacity(materials.len());
        let mut words = 0;
        for (i, material) in materials.iter().enumerate() {
            let plain = interface::Material { albedo: material.albedo, ..interface::Material::default() };
            let Some(map) = &material.color else {
                packed.push(plain);
                continue;
            };
            let shares = |other: &Material| other.color.as_ref().is_some_and(|other| Arc::ptr_eq(other, map));
            let first_word = match materials[..i].iter().position(shares) {
                Some(other) => packed[other].first_word,
                None => grown(&mut words, mip_levels::words(map, filter))?,
            };
            packed.push(interface::Material {
                color_format: map.format,
                color_width: map.width,
                color_height: map.height,
                color_wrap: material.wrap.unwrap_or(usual_wrap).id(),
                first_word,
                ..plain
            });
        }
        let format = common(packed.iter().map(|material| material.color_format), color_format::PER_MATERIAL);
        let mapped = packed.iter().filter(|material| material.color_format != color_format::NONE);
        let wrap = common(mapped.map(|material| material.color_wrap), wrap::PER_MAP);
        let mut texels = Vec::new();
        for (material, packed) in materials.into_iter().zip(&packed) {
            let Some(map) = material.color else { continue };
            if texels.is_empty() {
                texels = mip_levels::packed(map, filter);
            } else if packed.first_word as usize == texels.len() {
                texels.extend(mip_levels::packed(map, filter));
            }
        }
        Ok(Colors { materials: packed, texels, format, wrap })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::ColorMap;
    use glam::Vec3;

    fn map(format: u32, words: u32) -> Arc<ColorMap> {
        Arc::new(ColorMap { width: 1, height: 1, format, texels: (0..words).collect() })
    }

    fn material(color: Option<&Arc<ColorMap>>, wrap: Option<Wrap>) -> Material {
        Material { color: color.cloned(), wrap, ..Material::default() }
    }

    #[test]
    fn maps_are_packed_once_and_what_differs_is_mixed() {
        let (a, b) = (map(color_format::SRGB8, 257), map(color_format::FLOAT32, 3));
        let materials = vec![
            material(None, Some(Wrap::Clamp)),
            material(Some(&a), None),
            Material { albedo: Vec3::X, ..material(Some(&b), Some(Wrap::Mirror)) },
            material(Some(&a), Some(Wrap::Mirror)),
        ];
        let colors = Colors::pack(materials, Wrap::Mirror, Filter::Bilinear).expect("small");
        let firsts: Vec<_> = colors.materials.iter().map(|material| material.first_word).collect();
        assert_eq!((firsts, colors.texels.len()), (vec![0, 0, 257, 0], 260));
        assert_eq!((colors.texels[256], colors.texels[257]), (256, 0));
        // The clamped one has no map.
        assert_eq!((colors.format, colors.wrap), (color_format::PER_MATERIAL, wrap::MIRROR));
        assert_eq!(colors.materials[2].albedo, Vec3::X);
    }

    #[test]
    fn what_is_alike_is_known() {
        let a = map(color_format::SRGB8, 257);
        let alike = vec![material(Some(&a), None), material(Some(&map(color_format::SRGB8, 257)), None)];
        let colors = Colors::pack(alike, Wrap::Clamp, Filter::Bilinear).expect("small");
        assert_eq!((colors.format, colors.wrap), (color_format::SRGB8, wrap::CLAMP));
        let none = Colors::pack(vec![material(None, None); 2], Wrap::Clamp, Filter::Bilinear).expect("small");
        assert_eq!((none.format, none.texels.len()), (color_format::NONE, 0));
        let wraps = vec![material(Some(&a), None), material(Some(&a), Some(Wrap::Mirror))];
        assert_eq!(Colors::pack(wraps, Wrap::Clamp, Filter::Bilinear).expect("small").wrap, wrap::PER_MAP);
    }

    /// Words of all levels, so that the next map begins behind them.
    #[test]
    fn filtered_maps_have_their_levels_behind_them() {
        let sized = |format, table: u32, words: u32| {
            let texels = (0..table + 15 * words).collect();
            Arc::new(ColorMap { width: 5, height: 3, format, texels })
        };
        let maps = [sized(color_format::SRGB8, 256, 1), sized(color_format::FLOAT32, 0, 3)];
        let materials = maps.iter().map(|map| material(Some(map), None)).collect();
        let colors = Colors::pack(materials, Wrap::Clamp, Filter::Trilinear).expect("small");
        // 5x3, 2x1 and 1x1.
        assert_eq!([0, 1].map(|i| colors.materials[i].first_word), [0, 256 + 18]);
        assert_eq!(colors.texels.len(), 256 + 18 + 3 * 18);
    }
}
