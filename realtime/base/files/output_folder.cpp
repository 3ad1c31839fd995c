#include "realtime/base/files/output_folder.hpp"

#include <fcntl.h>
#include <fnmatch.h>
#include <stdio.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <optional>
#include <system_error>

#include "realtime/base/files/descriptor.hpp"
#include "realtime/base/input_error.hpp"

namespace fathom {
namespace {

namespace fs = std::filesystem;

fs::path withoutTrailingSlash(const fs::path& path) {
  return path.has_filename() ? path : path.parent_path();
}

// Where links lead to, at last, be it there or not.
fs::path followed(fs::path path) {
  constexpr int kMostLinks = 40;  // as the kernel follows
  std::error_code error;
  for (int k = 0; k < kMostLinks && fs::is_symlink(path, error); ++k)
    path = withoutTrailingSlash((path.parent_path() / fs::read_symlink(path)).lexically_normal());
  return path;
}

// The folder, locked; none where another program holds it, or has just removed or replaced it.
std::optional<Descriptor> locked(const fs::path& folder) {
  Descriptor file(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  struct stat held {
  }, there{};
  const bool other = file.open() && (lockedElsewhere(file.get()) || ::fstat(file.get(), &held) != 0 ||
                                     ::stat(folder.c_str(), &there) != 0 || held.st_ino != there.st_ino);
  return other ? std::nullopt : std::optional(std::move(file));
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
    : folder_(followed(withoutTrailingSlash(folder.lexically_normal()))),
      temporary_(withEnding(folder_, ".tmp")),
      aside_(withEnding(folder_, ".old.tmp")),
      ours_(ours.begin(), ours.end()),
      outlives_(life.outlives),
      durable_(life.durable) {
  std::error_code error;
  fs::create_directories(temporary_, error);
  if (error)
    throw InputError(temporary_.string(), "",
                     "cannot be made (" + error.message() + "); choose another folder");
  auto lock = locked(temporary_);
  if (!lock)
    throw InputError(folder_.string(), "",
                     "is being written by another program; wait for it, or choose another folder");
  lock_ = std::move(*lock);
  try {
    takeOver(life.reopen);
  } catch (...) {
    fs::remove(temporary_, error);  // if it is empty
    throw;
  }
}

// What programs that were killed left.
void OutputFolder::takeOver(bool reopen) {
  std::error_code error;
  if (fs::exists(aside_, error) && !fs::exists(folder_, error)) fs::rename(aside_, folder_);
  for (const fs::path& folder : {folder_, aside_, temporary_}) refuseOtherFiles(folder);
  fs::remove_all(aside_, error);
  if (reopen) return;
  for (const auto& entry : fs::directory_iterator(temporary_)) fs::remove_all(entry.path(), error);
}

OutputFolder::~OutputFolder() {
  if (outlives_) return;
  std::error_code ignored;
  fs::remove_all(temporary_, ignored);
}

void OutputFolder::refuseOtherFiles(const fs::path& folder) const {
  std::error_code error;
  if (!fs::exists(folder, error)) return;
  if (!fs::is_directory(folder, error))
    throw InputError(folder.string(), "", "is not a folder; choose another folder");
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.symlink_status().type() == fs::file_type::directory) continue;
    const std::string name = entry.path().lexically_relative(folder).generic_string();
    const bool known = std::any_of(ours_.begin(), ours_.end(), [&](const std::string& pattern) {
      return ::fnmatch(pattern.c_str(), name.c_str(), FNM_PATHNAME | FNM_PERIOD | FNM_EXTMATCH) == 0;
    });
    const bool half_written = folder != folder_ && name.find(".tmp") != std::string::npos;
    if (!known && !half_written)
      throw InputError(folder.string(), name,
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
  refuseOtherFiles(folder_);
  if (durable_) bringToDisk();
  if (!fs::exists(folder_)) {
    fs::rename(temporary_, folder_);
  } else {
    if (auto lock = locked(folder_)) old_lock_ = std::move(*lock);
    if (!exchange(temporary_, folder_)) {
      fs::rename(folder_, aside_);
      fs::rename(temporary_, folder_);
      std::error_code ignored;  // what stays goes with the next run
      fs::remove_all(aside_, ignored);
    }
  }
  outlives_ = false;  // after an exchange path() is the old folder
  if (durable_) sync(folder_.has_parent_path() ? folder_.parent_path() : fs::path("."));
}

}  // namespace fathom
