#include "recon/topside/work/work_file.hpp"

#include <unistd.h>

#include <array>
#include <cstring>
#include <limits>

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

}  // namespace fathom::topside
