#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include "tests/support/text_files.hpp"

namespace fathom::test {

// A file of the real captures. Begin a test with FATHOM_REQUIRE_DATA so that it skips, saying so, without
// them.
inline std::filesystem::path dataFile(const std::string& relative) {
  return std::filesystem::path(FATHOM_DATA_DIR) / relative;
}

// A fresh folder that is removed at the end of the test.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    static int counter = 0;
    path_ = std::filesystem::temp_directory_path() /
            ("fathom-test-" + std::to_string(::getpid()) + "-" + std::to_string(counter++));
    std::filesystem::create_directories(path_);
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace fathom::test

#define FATHOM_REQUIRE_DATA(relative)                                                        \
  if (!std::filesystem::exists(fathom::test::dataFile(relative)))                            \
  GTEST_SKIP() << "no real captures: " << fathom::test::dataFile(relative) << " is absent; " \
               << "set FATHOM_DATA_DIR"
