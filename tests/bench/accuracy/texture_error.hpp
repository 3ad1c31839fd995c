#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "tests/bench/accuracy/model_tiles.hpp"
#include "tests/bench/accuracy/view_from_above.hpp"

namespace fathom::accuracy {

// How far a level's texture is from the true appearance. Lighting correction gives each channel one mean and
// spread over the mission: one gain and offset a channel, fitted over the level, are no error.
struct TextureError {
  std::size_t windows = 0, pixels = 0;
  double pixel = 0;                     // of the windows: the level's texel [m]
  double shift_p50 = 0, shift_p95 = 0;  // of a window's texture against the truth [m]
  double psnr = 0, ssim = 0,
         correlation = 0;  // after each window's own shift; PSNR by 255, SSIM of brightness
  double psnr_in_place = 0, ssim_in_place = 0;  // where the model says that it is
  // Of edges: gradient energy of the texture over that of the truth (after gain): below 1 is blurred.
  double detail = 0;
};

// Windows of up to 384 texels in the middle of up to `most` tiles, spread over the level; of a level of few
// tiles several each.
[[nodiscard]] TextureError textureErrorOf(const ModelTiles& tiles, int level, const sim::Appearance& truth,
                                          const SE3& T_truth_model, std::size_t most);

// The whole model from above beside the truth, and their difference (grey: none; four times): PNG.
// `longest`: of either picture [px].
void drawBesideTruth(const ModelTiles& tiles, const sim::Appearance& truth, const SE3& T_truth_model,
                     int longest, const std::filesystem::path& png);
// The same of one window of a level, texel by texel.
void drawWindowBesideTruth(const ModelTiles& tiles, int level, const sim::Appearance& truth,
                           const SE3& T_truth_model, const std::filesystem::path& png);

}  // namespace fathom::accuracy
