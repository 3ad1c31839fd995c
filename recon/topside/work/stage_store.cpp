#include "recon/topside/work/stage_store.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/files/descriptor.hpp"
#include "realtime/base/input_error.hpp"

namespace fathom::topside {
namespace fs = std::filesystem;
namespace {

constexpr const char* kMark = "fathom-work";  // names a work folder; processes lock it
constexpr const char* kExtension = ".work";
constexpr const char* kCosts = ".costs";
constexpr const char* kTemporary = ".tmp";

// Item of a file's name "<item>-<key><extension>"; empty for another.
std::string itemOfFile(const fs::path& path, const char* extension) {
  const std::string name = path.stem().string();
  constexpr std::size_t kKey = 17;  // "-" and 16 digits
  if (path.extension() != extension || name.size() <= kKey || name[name.size() - kKey] != '-') return {};
  return name.substr(0, name.size() - kKey);
}

bool holdsOurs(const fs::path& folder) {
  std::error_code error;
  return fs::exists(folder / kMark, error) || fs::is_empty(folder, error);
}

void sweep(const fs::path& folder) {
  std::error_code error;
  for (const auto& entry : fs::recursive_directory_iterator(folder, error))
    if (entry.path().extension() == kTemporary) fs::remove(entry.path(), error);
}

}  // namespace

StageStore::StageStore(fs::path folder, Access access) : folder_(std::move(folder)) {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (!fs::is_directory(folder_, error))
    throw InputError(folder_.string(), "", "cannot be made: the work needs a folder");
  if (!holdsOurs(folder_))
    throw InputError(folder_.string(), "", "holds other files; give an empty folder for the work (--work)");
  lock_ = ::open((folder_ / kMark).c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (lock_ < 0) throw InputError(folder_.string(), "", std::string("cannot be written: ") + strerror(errno));
  // A file system without locks is taken as it is: whoever starts jobs on it keeps them apart.
  if (lockedElsewhere(lock_, access == Access::kAlone ? LOCK_EX : LOCK_SH)) {
    ::close(lock_);
    throw InputError(folder_.string(), "", "another run works here; wait for it, or give another --work");
  }
  if (access == Access::kAlone) sweep(folder_);
}

StageStore::~StageStore() {
  ::close(lock_);
}

fs::path StageStore::pathOf(const std::string& stage, const std::string& item, const Digest& key) const {
  return folder_ / stage / (item + "-" + key.shortHex() + kExtension);
}

std::optional<WorkFile> StageStore::find(const std::string& stage, const std::string& item,
                                         const Digest& key) {
  const fs::path path = pathOf(stage, item, key);
  auto file = WorkFile::open(path, key);
  if (file) {
    const auto known = [&] {
      const std::lock_guard lock(mutex_);
      return checked_.contains(path);
    };
    if (known()) return file;
    if (file->whole()) {
      const std::lock_guard lock(mutex_);
      checked_.insert(path);
      return file;
    }
  }
  std::error_code error;
  if (fs::exists(path, error)) {
    std::fprintf(stderr, "%s: damaged; it will be made again\n", path.c_str());
    ++damaged_;
    fs::remove(path, error);
  }
  return std::nullopt;
}

std::optional<WorkFile> StageStore::open(const std::string& stage, const std::string& item,
                                         const Digest& key) const {
  return WorkFile::open(pathOf(stage, item, key), key);
}

WorkFile StageStore::get(const std::string& stage, const std::string& item, const Digest& key) const {
  auto file = open(stage, item, key);
  if (!file) throw DamagedWork(pathOf(stage, item, key));
  return std::move(*file);
}

WorkFileWriter StageStore::writer(const std::string& stage, const std::string& item, const Digest& key) {
  fs::create_directories(folder_ / stage);
  return {pathOf(stage, item, key), key};
}

void StageStore::written(const std::string& stage, const std::string& item, const Digest& key,
                         const Costs& costs) {
  const fs::path path = pathOf(stage, item, key), costs_path = fs::path(path).replace_extension(kCosts);
  { writeFile(costs_path, nlohmann::json(costs).dump() + "\n"); }
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_ / stage, error)) {
    const fs::path& other = entry.path();
    if (other == path || other == costs_path) continue;
    if (itemOfFile(other, kExtension) == item || itemOfFile(other, kCosts) == item) fs::remove(other, error);
  }
  const std::lock_guard lock(mutex_);
  checked_.insert(path);
}

void StageStore::keepOnly(const std::string& stage, const std::set<std::string>& items) {
  std::vector<fs::path> old;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_ / stage, error))
    for (const char* extension : {kExtension, kCosts}) {
      const std::string item = itemOfFile(entry.path(), extension);
      if (!item.empty() && !items.contains(item)) old.push_back(entry.path());
    }
  for (const fs::path& path : old) fs::remove(path, error);
}

std::map<std::string, Costs> StageStore::costs(const std::string& stage) const {
  std::map<std::string, Costs> all;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_ / stage, error)) {
    const std::string item = itemOfFile(entry.path(), kCosts);
    if (item.empty()) continue;
    std::ifstream in(entry.path());
    const nlohmann::json json = nlohmann::json::parse(in, nullptr, false);
    if (!json.is_object()) continue;
    Costs& costs = all[item];
    for (const auto& [name, value] : json.items())
      if (value.is_number()) costs[name] = value.get<double>();
  }
  return all;
}

}  // namespace fathom::topside
