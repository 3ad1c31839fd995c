#pragma once

#include <cpl_error.h>
#include <gdal_priv.h>

#include <filesystem>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>

namespace fathom::topside {

using DatasetPtr = GDALDatasetUniquePtr;

// GDAL's drivers, and its errors kept for gdalFailed() instead of on stderr, as long as it lives.
class GdalUse {
 public:
  GdalUse() {
    static std::once_flag once;
    std::call_once(once, GDALAllRegister);
    CPLPushErrorHandler(CPLQuietErrorHandler);
    CPLErrorReset();
  }
  ~GdalUse() { CPLPopErrorHandler(); }
  GdalUse(const GdalUse&) = delete;
  GdalUse& operator=(const GdalUse&) = delete;
};

[[noreturn]] inline void gdalFailed(const std::filesystem::path& path) {
  throw std::runtime_error(path.string() + ": " + CPLGetLastErrorMsg());
}

// A file that GDAL writes under a temporary name with the same ending, by which drivers know their format.
class GdalTarget {
 public:
  explicit GdalTarget(const std::filesystem::path& path) : path_(path), temporary_(path) {
    temporary_.replace_filename(path.stem().string() + ".tmp" + path.extension().string());
    std::error_code ignored;
    std::filesystem::remove(temporary_, ignored);
  }
  ~GdalTarget() {
    std::error_code ignored;
    std::filesystem::remove(temporary_, ignored);
  }
  GdalTarget(const GdalTarget&) = delete;
  GdalTarget& operator=(const GdalTarget&) = delete;

  [[nodiscard]] const std::filesystem::path& temporary() const { return temporary_; }
  void commit() { std::filesystem::rename(temporary_, path_); }

 private:
  std::filesystem::path path_, temporary_;
};

}  // namespace fathom::topside
