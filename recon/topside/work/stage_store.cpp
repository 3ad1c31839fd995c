#include "recon/topside/work/stage_store.hpp"

#include <fcntl.h>
#include <unistd.h>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/files/descriptor.hpp"
#include "realtime/base/input_error.hpp"
#include "recon/topside/work/saved_bytes.hpp"

namespace fathom::topside {
namespace {

constexpr std::uint32_t kMagic = rt::stateTag("FWRK");
constexpr std::uint32_t kFormat = 1;
constexpr std::uint64_t kMaxIndex = std::uint64_t{1} << 30;  // bytes: more is damage

// The last bytes of a file.
struct Tail {
  std::uint64_t index_offset = 0;
  Digest index_digest;
  std::uint32_t format = kFormat, magic = kMagic;
};
static_assert(sizeof(Tail) == 48);

// Host and process, for files that several machines write into one folder.
std::string ownSuffix() {
  std::array<char, 64> host{};
  if (::gethostname(host.data(), host.size() - 1) != 0) host[0] = 0;
  return "." + std::string(host.data()) + "." + std::to_string(::getpid()) + ".tmp";
}

template <typename Archive, typename Index>
void exchangeIndex(Archive& archive, Digest& key, Index& index) {
  archive(key.bytes);
  if constexpr (Archive::kLoading) {
    std::uint64_t count = 0;
    archive(count);
    for (std::uint64_t k = 0; k < count && archive.ok(); ++k) {
      std::string name;
      BlockPlace place;
      archive(name, place.offset, place.size, place.digest.bytes);
      index.emplace(std::move(name), place);
    }
  } else {
    archive(static_cast<std::uint64_t>(index.size()));
    for (const auto& [name, place] : index) archive(name, place.offset, place.size, place.digest.bytes);
  }
}

bool readAt(std::ifstream& in, std::uint64_t offset, void* data, std::uint64_t size) {
  in.seekg(static_cast<std::streamoff>(offset));
  return static_cast<bool>(in.read(static_cast<char*>(data), static_cast<std::streamsize>(size)));
}

std::optional<Bytes> readBlock(std::ifstream& in, const BlockPlace& place) {
  Bytes bytes(place.size);
  if (!readAt(in, place.offset, bytes.data(), place.size)) return std::nullopt;
  if (digestOf(bytes) != place.digest) return std::nullopt;
  return bytes;
}

}  // namespace

WorkFileWriter::WorkFileWriter(std::filesystem::path path, const Digest& key)
    : path_(std::move(path)), temporary_(path_.string() + ownSuffix()), key_(key) {
  stream_.exceptions(std::ios::failbit | std::ios::badbit);
  try {
    stream_.open(temporary_, std::ios::binary | std::ios::trunc);
  } catch (const std::ios::failure&) {
    throw std::runtime_error(temporary_.string() + ": cannot be written");
  }
}

WorkFileWriter::~WorkFileWriter() {
  if (committed_) return;
  std::error_code ignored;
  std::filesystem::remove(temporary_, ignored);
}

void WorkFileWriter::add(const std::string& name, std::span<const std::uint8_t> bytes) {
  if (!index_.emplace(name, BlockPlace{at_, bytes.size(), digestOf(bytes)}).second)
    throw std::logic_error("a block of a work file has the name of another");
  stream_.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  at_ += bytes.size();
}

void WorkFileWriter::commit() {
  const Bytes index = savedBytes([&](rt::StateWriter& w) { exchangeIndex(w, key_, index_); });
  Tail tail;
  tail.index_offset = at_;
  tail.index_digest = digestOf(index);
  try {
    stream_.write(reinterpret_cast<const char*>(index.data()), static_cast<std::streamsize>(index.size()));
    stream_.write(reinterpret_cast<const char*>(&tail), sizeof tail);
    stream_.close();
  } catch (const std::ios::failure&) {
    throw std::runtime_error(temporary_.string() + ": cannot be written; is the disk full?");
  }
  std::filesystem::rename(temporary_, path_);
  committed_ = true;
}

std::optional<WorkFile> WorkFile::open(const std::filesystem::path& path, const Digest& key) {
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  if (!in) return std::nullopt;
  const auto size = static_cast<std::uint64_t>(in.tellg());
  Tail tail;
  if (size < sizeof tail || !readAt(in, size - sizeof tail, &tail, sizeof tail)) return std::nullopt;
  if (tail.magic != kMagic || tail.format != kFormat || tail.index_offset > size - sizeof tail)
    return std::nullopt;
  const std::uint64_t index_size = size - sizeof tail - tail.index_offset;
  if (index_size > kMaxIndex) return std::nullopt;
  Bytes index(index_size);
  if (!readAt(in, tail.index_offset, index.data(), index_size)) return std::nullopt;
  if (topside::digestOf(index) != tail.index_digest) return std::nullopt;
  WorkFile file;
  file.path_ = path;
  rt::StateReader reader(index);
  Digest found;
  exchangeIndex(reader, found, file.index_);
  if (!reader.ok() || found != key) return std::nullopt;
  Hasher content;
  for (const auto& [name, place] : file.index_) {
    if (place.offset > tail.index_offset || place.size > tail.index_offset - place.offset)
      return std::nullopt;
    content.add(name, place.digest);
  }
  file.content_ = content.finish();
  return file;
}

Bytes WorkFile::read(const std::string& name) const {
  const auto place = index_.find(name);
  std::ifstream in(path_, std::ios::binary);
  if (place == index_.end() || !in) throw DamagedWork(path_);
  auto bytes = readBlock(in, place->second);
  if (!bytes) throw DamagedWork(path_);
  return std::move(*bytes);
}

const Digest& WorkFile::digestOf(const std::string& name) const {
  const auto place = index_.find(name);
  if (place == index_.end()) throw DamagedWork(path_);
  return place->second.digest;
}

bool WorkFile::whole() const {
  std::ifstream in(path_, std::ios::binary);
  if (!in) return false;
  for (const auto& [name, place] : index_)
    if (!readBlock(in, place)) return false;
  return true;
}

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
