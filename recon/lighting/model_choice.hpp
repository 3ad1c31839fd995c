#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "recon/lighting/lighting_model.hpp"

namespace fathom::lighting {

// Which model foretells images best, by its errors on images that it had not learnt yet.
class ModelChoice {
 public:
  // One image's mean absolute errors, in logarithms; negative: not tried.
  void score(double whole, double plain, double range) {
    const std::array<double, kModels> now = {whole, plain, range};
    for (std::size_t k = 0; k < kModels; ++k) {
      if (now[k] < 0) continue;
      count_[k] = std::min(count_[k] + 1, kWindow);
      error_[k] += (now[k] - error_[k]) / count_[k];
    }
    if (count_[chosen_] < kFewest) return;
    std::size_t best = chosen_;
    for (std::size_t k = 0; k < kModels; ++k)
      if (count_[k] >= kFewest && error_[k] < error_[best]) best = k;
    if (error_[best] < kBetter * error_[chosen_]) chosen_ = best;
  }

  [[nodiscard]] LightingKind best() const {
    return static_cast<LightingKind>(chosen_ + static_cast<std::size_t>(LightingKind::kWholeImage));
  }
  [[nodiscard]] double error(LightingKind kind) const {
    const auto k = static_cast<std::size_t>(kind) - static_cast<std::size_t>(LightingKind::kWholeImage);
    return count_[k] > 0 ? error_[k] : -1;
  }

  // For saved state (state_archive.hpp), bit by bit.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    std::uint64_t chosen = self.chosen_;
    archive(chosen, self.count_, self.error_);
    archive.require(chosen < kModels, "a model that there is not");
    if constexpr (Archive::kLoading)
      if (archive.ok()) self.chosen_ = chosen;
  }

 private:
  static constexpr std::size_t kModels = 3;
  static constexpr double kWindow = 100;  // images that the mean error goes back over
  static constexpr double kFewest = 8;    // images before an error counts
  static constexpr double kBetter = 0.95;
  std::size_t chosen_ = 1;  // the plain one, until another is better
  std::array<double, kModels> count_{}, error_{};
};

}  // namespace fathom::lighting
