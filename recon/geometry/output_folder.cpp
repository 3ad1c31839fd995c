#include "recon/geometry/output_folder.hpp"

#include <fcntl.h>
#include <stdio.h>

#include <algorithm>
#include <string>
#include <system_error>

#include "realtime/kernel/input_error.hpp"

namespace fathom {
namespace {

namespace fs = std::filesystem;

fs::path withoutTrailingSlash(const fs::path& path) {
  return path.has_filename() ? path : path.parent_path();
}

}  // namespace

OutputFolder::OutputFolder(const fs::path& folder, std::span<const std::string_view> ours, const Life& life)
    : folder_(withoutTrailingSlash(folder.lexically_normal())), outlives_(life.outlives) {
  temporary_ = folder_;
  temporary_ += ".tmp";
  std::error_code error;
  if (fs::exists(folder_, error)) {
    if (!fs::is_directory(folder_, error))
      throw InputError(folder_.string(), "", "is not a folder; choose another folder");
    for (const auto& entry : fs::directory_iterator(folder_)) {
      const std::string name = entry.path().filename().string();
      if (std::find(ours.begin(), ours.end(), name) == ours.end())
        throw InputError(folder_.string(), name,
                         "is not of an earlier run and would be lost; choose another folder");
    }
  }
  if (!life.reopen) fs::remove_all(temporary_, error);
  fs::create_directories(temporary_, error);
  if (error)
    throw InputError(temporary_.string(), "",
                     "cannot be made (" + error.message() + "); choose another folder");
}

OutputFolder::~OutputFolder() {
  if (outlives_) return;
  std::error_code ignored;
  fs::remove_all(temporary_, ignored);
}

void OutputFolder::commit() {
  outlives_ = false;
  if (fs::exists(folder_)) {
    // Exchanged in one step; what was the old folder goes with the destructor.
    if (::renameat2(AT_FDCWD, temporary_.c_str(), AT_FDCWD, folder_.c_str(), RENAME_EXCHANGE) == 0) return;
    fs::remove_all(folder_);  // a file system that cannot exchange
  }
  fs::rename(temporary_, folder_);
}

}  // namespace fathom
