#include "recon/topside/output_folder.hpp"

#include <fcntl.h>
#include <stdio.h>

#include <algorithm>
#include <array>
#include <string_view>
#include <system_error>

#include "realtime/kernel/input_error.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;

// What topside/ of a mission folder may hold.
constexpr std::array<std::string_view, 9> kOurs = {"stereo_pose_est.data",
                                                   "vehicle_pose_est.data",
                                                   "closures.csv",
                                                   "mesh.ply",
                                                   "mesh.png",
                                                   "tiles",
                                                   "layers",
                                                   "report.json",
                                                   "report.html"};

fs::path withoutTrailingSlash(const fs::path& path) {
  return path.has_filename() ? path : path.parent_path();
}

}  // namespace

OutputFolder::OutputFolder(fs::path folder) : folder_(withoutTrailingSlash(folder.lexically_normal())) {
  temporary_ = folder_;
  temporary_ += ".tmp";
  std::error_code error;
  if (fs::exists(folder_, error)) {
    if (!fs::is_directory(folder_, error))
      throw InputError(folder_.string(), "", "is not a folder; choose another --out");
    for (const auto& entry : fs::directory_iterator(folder_)) {
      const std::string name = entry.path().filename().string();
      if (std::find(kOurs.begin(), kOurs.end(), name) == kOurs.end())
        throw InputError(folder_.string(), name,
                         "is not of an earlier run and would be lost; choose another --out");
    }
  }
  fs::remove_all(temporary_, error);
  fs::create_directories(temporary_, error);
  if (error)
    throw InputError(temporary_.string(), "",
                     "cannot be made (" + error.message() + "); choose another --out");
}

OutputFolder::~OutputFolder() {
  std::error_code ignored;
  fs::remove_all(temporary_, ignored);
}

void OutputFolder::commit() {
  if (fs::exists(folder_)) {
    // Exchanged in one step; what was the old folder goes with the destructor.
    if (::renameat2(AT_FDCWD, temporary_.c_str(), AT_FDCWD, folder_.c_str(), RENAME_EXCHANGE) == 0) return;
    fs::remove_all(folder_);  // a file system that cannot exchange
  }
  fs::rename(temporary_, folder_);
}

}  // namespace fathom::topside
