#include "recon/geometry/output_folder.hpp"

#include <fcntl.h>
#include <fnmatch.h>
#include <stdio.h>

#include <algorithm>
#include <cerrno>
#include <system_error>

#include "realtime/kernel/descriptor.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom {
namespace {

namespace fs = std::filesystem;

fs::path withoutTrailingSlash(const fs::path& path) {
  return path.has_filename() ? path : path.parent_path();
}

fs::path withEnding(fs::path path, const char* ending) {
  path += ending;
  return path;
}

void sync(const fs::path& path) {
  if (!syncPath(path.c_str()))
    throw std::system_error(errno, std::generic_category(), path.string() + " cannot be brought to the disk");
}

}  // namespace

OutputFolder::OutputFolder(const fs::path& folder, std::span<const std::string_view> ours, const Life& life)
    : folder_(withoutTrailingSlash(folder.lexically_normal())),
      temporary_(withEnding(folder_, ".tmp")),
      aside_(withEnding(folder_, ".old.tmp")),
      ours_(ours.begin(), ours.end()),
      outlives_(life.outlives),
      durable_(life.durable) {
  std::error_code error;
  if (fs::exists(aside_, error) && !fs::exists(folder_, error)) fs::rename(aside_, folder_);
  refuseOtherFiles();
  fs::remove_all(aside_, error);
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

void OutputFolder::refuseOtherFiles() const {
  std::error_code error;
  if (!fs::exists(folder_, error)) return;
  if (!fs::is_directory(folder_, error))
    throw InputError(folder_.string(), "", "is not a folder; choose another folder");
  for (const auto& entry : fs::recursive_directory_iterator(folder_)) {
    if (entry.symlink_status().type() == fs::file_type::directory) continue;
    const std::string name = entry.path().lexically_relative(folder_).generic_string();
    const bool known = std::any_of(ours_.begin(), ours_.end(), [&](const std::string& pattern) {
      return ::fnmatch(pattern.c_str(), name.c_str(), FNM_PATHNAME | FNM_PERIOD | FNM_EXTMATCH) == 0;
    });
    if (!known)
      throw InputError(folder_.string(), name,
                       "is not of an earlier run and would be lost; move it, or choose another folder");
  }
}

bool OutputFolder::exchanged(const fs::path& a, const fs::path& b) {
  return ::renameat2(AT_FDCWD, a.c_str(), AT_FDCWD, b.c_str(), RENAME_EXCHANGE) == 0;
}

void OutputFolder::bringToDisk() const {
  for (const auto& entry : fs::recursive_directory_iterator(temporary_))
    if (!entry.is_symlink()) sync(entry.path());
  sync(temporary_);
}

void OutputFolder::commit(const Exchange& exchange) {
  refuseOtherFiles();
  if (durable_) bringToDisk();
  if (!fs::exists(folder_)) {
    fs::rename(temporary_, folder_);
  } else if (!exchange(temporary_, folder_)) {
    fs::rename(folder_, aside_);
    fs::rename(temporary_, folder_);
    std::error_code ignored;  // what stays goes with the next run
    fs::remove_all(aside_, ignored);
  }
  outlives_ = false;  // after an exchange path() is the old folder
  if (durable_) sync(folder_.has_parent_path() ? folder_.parent_path() : fs::path("."));
}

}  // namespace fathom
