#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "telemetry/monitor/model/model_view.hpp"

namespace fathom::monitor {

// The exports as files in a folder, each written under another name first. A disk that refuses, or an export
// that fails, ends nothing: trouble() says so, and the next save() writes again.
class ExportFiles {
 public:
  explicit ExportFiles(std::filesystem::path folder) : folder_(std::move(folder)) {}
  // Writes those that have changed and exist.
  void save(ModelView& view);
  // Why the last save() did not succeed; "": it did.
  [[nodiscard]] const std::string& trouble() const { return trouble_; }

 private:
  std::filesystem::path folder_;
  std::string trouble_;
  std::uint64_t saved_epoch_ = 0, saved_map_ = UINT64_MAX;
  std::size_t saved_track_ = 0;
  bool saved_origin_ = false;
};

}  // namespace fathom::monitor
