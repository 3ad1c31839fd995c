#include "realtime/onboard/slots/slot_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <type_traits>
#include <utility>

#include "realtime/base/bytes/crc32.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/hash64.hpp"

namespace fathom::onboard {
namespace {

constexpr std::uint64_t kMagic = 0x4f444e554d485446ULL;  // "FTHMUNDO"
constexpr std::uint64_t kFirst = 4096;                   // offset of the first record: a block of the disk

struct Head {
  std::uint64_t magic = kMagic, boot = 0, slots = 0, slot_bytes = 0, first = kFirst, needs_check = 0;
};
static_assert(std::has_unique_object_representations_v<Head>);

// Of the machine since it was started; 0: not known.
std::uint64_t bootNumber() {
  std::string text;
  std::getline(std::ifstream("/proc/sys/kernel/random/boot_id"), text);
  std::uint64_t number = 0;
  for (const char c : text) number = hash64(number ^ static_cast<std::uint8_t>(c));
  return number;
}

// A file that is gone with the program.
Descriptor nameless(const std::filesystem::path& folder) {
  std::string name = (folder / "slots.XXXXXX").string();
  Descriptor file(::mkostemp(name.data(), O_CLOEXEC));
  if (!file.open())
    throw InputError(folder.string(), "slot file", std::string("cannot write here: ") + std::strerror(errno));
  ::unlink(name.c_str());
  return file;
}

Descriptor plainFile(const std::filesystem::path& path) {
  constexpr int kMode = 0644;
  Descriptor file(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, kMode));
  struct stat found {};
  if (file.open() && ::fstat(file.get(), &found) == 0 && S_ISREG(found.st_mode)) return file;
  const std::string why = file.open() ? "not a plain file" : std::strerror(errno);
  throw InputError(path.string(), "slot file", "cannot be opened: " + why);
}

}  // namespace

// Before the content, which it counts; a mark has none.
struct SlotJournal::Record {
  std::uint32_t crc = 0;  // of what follows, and the content
  std::uint32_t is_mark = 0;
  std::uint64_t number = 0;  // of the checkpoint or the slot
  std::uint64_t bytes = 0;
};

SlotJournal::SlotJournal(Descriptor file, bool reopen, std::size_t slots, std::size_t slot_bytes)
    : file_(std::move(file)),
      slots_(slots),
      slot_bytes_(slot_bytes),
      boot_(bootNumber()),
      kept_(slots),
      record_(sizeof(Record) + slot_bytes) {
  static_assert(std::has_unique_object_representations_v<Record>);
  marks_.reserve(kMostMarks);
  if (reopen)
    takeUp();
  else
    clear();
}

void SlotJournal::takeUp() {
  struct stat found {};
  Head head;
  std::array<std::uint8_t, sizeof head> bytes;
  if (::fstat(file_.get(), &found) != 0 || !readAt(file_.get(), bytes, 0)) return clear();
  std::memcpy(&head, bytes.data(), sizeof head);
  if (head.magic != kMagic || head.slots != slots_ || head.slot_bytes != slot_bytes_) return clear();
  const auto size = static_cast<std::uint64_t>(found.st_size);
  end_ = head.first;
  needs_check_ = head.needs_check != 0 || head.boot == 0 || head.boot != boot_;
  for (;;) {
    Record record;
    const Found what = readRecord(end_, size, record);
    needs_check_ = needs_check_ || what == Found::kDamaged;
    if (what != Found::kRecord) break;
    if (record.is_mark != 0) {
      if (marks_.size() == kMostMarks) marks_.erase(marks_.begin());
      marks_.push_back({record.number, end_});
      newEpoch();
    } else {
      kept_[record.number] = 1;
    }
    end_ += sizeof record + record.bytes;
  }
  if (marks_.empty() || !writeHead(head.first) || ::ftruncate(file_.get(), static_cast<off_t>(end_)) != 0)
    clear();
}

void SlotJournal::checked() noexcept {
  if (!needs_check_) return;
  needs_check_ = false;
  if (!writeHead(marks_.front().offset)) clear();
}

void SlotJournal::newEpoch() noexcept {
  std::fill(kept_.begin(), kept_.end(), std::uint8_t{0});
}

void SlotJournal::clear() noexcept {
  marks_.clear();
  newEpoch();
  end_ = 0;
  needs_check_ = false;
  (void)::ftruncate(file_.get(), 0);
}

bool SlotJournal::writeHead(std::uint64_t first) noexcept {
  const Head head = {kMagic, boot_, slots_, slot_bytes_, first, needs_check_ ? 1U : 0U};
  std::array<std::uint8_t, sizeof head> bytes;
  std::memcpy(bytes.data(), &head, sizeof head);
  return writeAt(file_.get(), bytes, 0) == bytes.size();
}

std::span<std::uint8_t> SlotJournal::content() noexcept {
  return std::span(record_).subspan(sizeof(Record));
}

// Appends the record with the first bytes of content().
bool SlotJournal::append(Record record, std::size_t bytes) noexcept {
  const std::span<std::uint8_t> whole(record_.data(), sizeof record + bytes);
  record.bytes = bytes;
  std::memcpy(whole.data(), &record, sizeof record);
  record.crc = crc32(whole.subspan(sizeof record.crc));
  std::memcpy(whole.data(), &record, sizeof record);
  if (writeAt(file_.get(), whole, end_) < whole.size()) return false;
  end_ += whole.size();
  return true;
}

void SlotJournal::keep(std::size_t slot, std::size_t bytes) noexcept {
  const std::span<const std::uint8_t> old = content();
  while (bytes > 0 && old[bytes - 1] == 0) --bytes;
  if (!append({0, 0, slot, 0}, bytes)) return clear();
  kept_[slot] = 1;
}

void SlotJournal::mark(std::uint64_t number) noexcept {
  if (marks_.size() == kMostMarks) forget(marks_[1].number);
  if (marks_.empty()) {
    if (!writeHead(kFirst)) return clear();
    end_ = kFirst;
  }
  const std::uint64_t offset = end_;
  if (!append({0, 1, number, 0}, 0)) return clear();
  marks_.push_back({number, offset});
  newEpoch();
}

SlotJournal::Found SlotJournal::readRecord(std::uint64_t offset, std::uint64_t end, Record& record) {
  if (offset == end) return Found::kEnd;
  if (offset > end) return Found::kDamaged;
  if (end - offset < sizeof record) return Found::kCutShort;
  if (!readAt(file_.get(), {record_.data(), sizeof record}, offset)) return Found::kDamaged;
  std::memcpy(&record, record_.data(), sizeof record);
  if (record.bytes > slot_bytes_ || (record.is_mark == 0 && record.number >= slots_)) return Found::kDamaged;
  if (end - offset - sizeof record < record.bytes) return Found::kCutShort;
  const std::span<std::uint8_t> whole(record_.data(), sizeof record + record.bytes);
  if (!readAt(file_.get(), whole.subspan(sizeof record), offset + sizeof record)) return Found::kDamaged;
  return crc32(whole.subspan(sizeof record.crc)) == record.crc ? Found::kRecord : Found::kDamaged;
}

// The newest of that number.
std::vector<SlotJournal::Mark>::iterator SlotJournal::find(std::uint64_t number) noexcept {
  const auto found = std::find_if(marks_.rbegin(), marks_.rend(),
                                  [number](const Mark& mark) { return mark.number == number; });
  return found == marks_.rend() ? marks_.end() : std::prev(found.base());
}

bool SlotJournal::eachSince(std::uint64_t number, const Restore& restore) {
  const auto mark = find(number);
  if (mark == marks_.end()) return false;
  std::vector<bool> restored(slots_);
  for (std::uint64_t at = mark->offset; at < end_;) {
    Record record;
    if (readRecord(at, end_, record) != Found::kRecord) return false;
    at += sizeof record + record.bytes;
    if (record.is_mark != 0 || restored[record.number]) continue;
    restored[record.number] = true;
    if (!restore(record.number, content().first(record.bytes))) return false;
  }
  return true;
}

void SlotJournal::beginAgain(std::uint64_t number) noexcept {
  const auto mark = find(number);
  if (mark == marks_.end()) return clear();
  end_ = mark->offset + sizeof(Record);
  marks_.erase(mark + 1, marks_.end());
  newEpoch();
  if (::ftruncate(file_.get(), static_cast<off_t>(end_)) != 0) clear();
}

void SlotJournal::forget(std::uint64_t before) noexcept {
  const auto first = std::find_if(marks_.begin(), marks_.end(),
                                  [before](const Mark& mark) { return mark.number >= before; });
  if (first == marks_.begin()) return;
  if (first == marks_.end()) return clear();
  marks_.erase(marks_.begin(), first);
  const std::uint64_t offset = marks_.front().offset;
  if (!writeHead(offset)) return;
  const std::uint64_t blocks = offset / kFirst * kFirst;
  if (blocks > kFirst)
    (void)::fallocate(file_.get(), FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, static_cast<off_t>(kFirst),
                      static_cast<off_t>(blocks - kFirst));
}

bool SlotJournal::sync() const noexcept {
  return ::fdatasync(file_.get()) == 0;
}

std::uint64_t SlotJournal::bytes() const noexcept {
  return marks_.empty() ? 0 : end_ - marks_.front().offset;
}

SlotFile::SlotFile(const std::filesystem::path& folder, std::size_t slots, std::size_t slot_bytes)
    : slots_(slots),
      slot_bytes_(slot_bytes),
      file_(allocated(nameless(folder), folder.string())),
      zeros_(slot_bytes),
      known_zero_(slots, std::uint8_t{1}),
      journal_(nameless(folder), false, slots, slot_bytes) {}

SlotFile::SlotFile(const Named& named, std::size_t slots, std::size_t slot_bytes)
    : path_(named.file),
      slots_(slots),
      slot_bytes_(slot_bytes),
      file_(openNamed(named)),
      zeros_(slot_bytes),
      known_zero_(slots, kept_ ? std::uint8_t{0} : std::uint8_t{1}),
      journal_(plainFile(journalPath()), kept_, slots, slot_bytes) {
  const std::filesystem::path folder = path_.parent_path();
  (void)syncPath(folder.empty() ? "." : folder.c_str());
}

Descriptor SlotFile::openNamed(const Named& named) {
  Descriptor file = plainFile(named.file);
  const off_t size = ::lseek(file.get(), 0, SEEK_END);
  kept_ = named.reopen && static_cast<std::size_t>(size) == slots_ * slot_bytes_;
  if (!kept_ && ::ftruncate(file.get(), 0) != 0)
    throw InputError(named.file.string(), "slot file",
                     std::string("cannot be emptied: ") + std::strerror(errno));
  return allocated(std::move(file), named.file.string());
}

Descriptor SlotFile::allocated(Descriptor file, const std::string& where) const {
  const std::size_t bytes = slots_ * slot_bytes_;
  const int failed = bytes == 0 ? 0 : ::posix_fallocate(file.get(), 0, static_cast<off_t>(bytes));
  if (failed == 0) return file;
  throw InputError(where, "slot file of " + std::to_string(bytes) + " bytes",
                   std::string(std::strerror(failed)) +
                       "; make room, set slam.slot_folder, or lower slam.max_keyframes or slam.max_pairs");
}

// A record is written before its slot is: with the journal behind the slots, too, each slot that is on the
// disk has its record there.
bool SlotFile::sync() const {
  return journal_.sync() && ::fdatasync(file_.get()) == 0 && journal_.sync();
}

void SlotFile::keepOld(std::size_t slot) {
  if (known_zero_[slot] != 0)
    journal_.keep(slot, 0);
  else if (readAt(file_.get(), journal_.content(), slot * slot_bytes_))
    journal_.keep(slot, slot_bytes_);
  else
    journal_.clear();
}

bool SlotFile::write(std::size_t slot, std::span<const std::uint8_t> data) {
  if (!fits(slot, data.size())) return false;
  if (journal_.wants(slot)) keepOld(slot);
  known_zero_[slot] = 0;
  return writeAt(file_.get(), data, slot * slot_bytes_) == data.size();
}

bool SlotFile::read(std::size_t slot, std::span<std::uint8_t> data) {
  return fits(slot, data.size()) && readAt(file_.get(), data, slot * slot_bytes_);
}

bool SlotFile::restore(std::size_t slot, std::span<const std::uint8_t> content) {
  const std::uint64_t at = slot * slot_bytes_;
  const auto rest = std::span<const std::uint8_t>(zeros_).subspan(content.size());
  known_zero_[slot] = content.empty() ? 1 : 0;
  return writeAt(file_.get(), content, at) == content.size() &&
         writeAt(file_.get(), rest, at + content.size()) == rest.size();
}

bool SlotFile::rollBack(std::uint64_t number) {
  if (number == 0) {
    for (std::size_t slot = 0; slot < slots_; ++slot)
      if (known_zero_[slot] == 0 && !restore(slot, {})) return false;
    journal_.clear();
    return true;
  }
  const bool all = journal_.eachSince(
      number,
      [this](std::size_t slot, std::span<const std::uint8_t> content) { return restore(slot, content); });
  // What the journal gives up now is in the slots, also after a power loss.
  if (!all || (!path_.empty() && ::fdatasync(file_.get()) != 0)) return false;
  journal_.beginAgain(number);
  return true;
}

}  // namespace fathom::onboard
