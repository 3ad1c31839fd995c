#include "realtime/onboard/slots/slot_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <string>
#include <utility>

#include "realtime/base/input_error.hpp"

namespace fathom::onboard {
namespace {

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
