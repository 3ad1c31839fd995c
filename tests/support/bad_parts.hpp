#pragma once

#include <cstring>
#include <filesystem>
#include <string>

#include "realtime/base/units.hpp"
#include "tests/support/bad_parts_control.hpp"
#include "tests/support/mapped_file.hpp"

namespace fathom::test {

// A part of the programs under test that fails when the test says so: of those that are started with
// environment() and have libfathom_bad_disk.so loaded, or link fathom_bad_disk_here.
class BadParts {
 public:
  explicit BadParts(const std::filesystem::path& file) : file_(file), control_(file) {}

  // At the part's next fault point; kSlow and kCorrupt for so long.
  void set(const char* part, PartFault fault, std::int64_t for_ms) {
    std::strncpy(control_->part, part, sizeof control_->part - 1);
    control_->until_ns = nowNs() + for_ms * kMillisecond_ns;
    control_->fault = fault;
  }
  void clear() { control_->fault = PartFault::kNone; }
  [[nodiscard]] bool hit() const { return control_->hit > 0; }
  // NAME=value.
  [[nodiscard]] std::string environment() const { return "FATHOM_BAD_PARTS=" + file_.string(); }

 private:
  std::filesystem::path file_;
  MappedFile<BadPartsControl> control_;
};

}  // namespace fathom::test
