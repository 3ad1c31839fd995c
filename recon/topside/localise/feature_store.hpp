#pragma once

#include <cstddef>

#include "recon/closure/frame_features.hpp"

namespace fathom::topside {

// What the pairs of a mission are recognised by, kept where the caller wants. load() may be called by several
// threads at once.
class FeatureStore {
 public:
  virtual ~FeatureStore() = default;
  [[nodiscard]] virtual std::size_t count(std::size_t pair) const = 0;  // 0: cannot be read, or shows nothing
  // Replaces `out`; its memory is used again. Throws InputError for a file that cannot be read any more.
  virtual void load(std::size_t pair, closure::FrameFeatures& out) const = 0;
};

}  // namespace fathom::topside
