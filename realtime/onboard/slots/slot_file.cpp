#include "realtime/onboard/slots/slot_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <string>

#include "realtime/kernel/input_error.hpp"

namespace fathom::onboard {
namespace {

// Calls a positioned read or write until all is done; false on an error or the end of the file.
template <typename Call, typename Byte>
bool whole(Call call, int file, Byte* data, std::size_t bytes, std::size_t from) {
  while (bytes > 0) {
    const ssize_t done = call(file, data, bytes, static_cast<off_t>(from));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) return false;
    data += done;
    bytes -= static_cast<std::size_t>(done);
    from += static_cast<std::size_t>(done);
  }
  return true;
}

}  // namespace

SlotFile::SlotFile(const std::filesystem::path& folder, std::size_t slots, std::size_t slot_bytes)
    : slots_(slots), slot_bytes_(slot_bytes) {
  std::string name = (folder / "slots.XXXXXX").string();
  file_ = ::mkostemp(name.data(), O_CLOEXEC);
  if (file_ < 0)
    throw InputError(folder.string(), "slot file", std::string("cannot write here: ") + std::strerror(errno));
  ::unlink(name.c_str());
  allocate(folder.string());
}

SlotFile::SlotFile(const Named& named, std::size_t slots, std::size_t slot_bytes)
    : path_(named.file), slots_(slots), slot_bytes_(slot_bytes) {
  constexpr int kMode = 0644;
  file_ = ::open(named.file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, kMode);
  struct stat found {};
  if (file_ < 0 || ::fstat(file_, &found) != 0 || !S_ISREG(found.st_mode)) {
    const std::string why = file_ < 0 ? std::strerror(errno) : "not a plain file";
    if (file_ >= 0) ::close(file_);
    throw InputError(named.file.string(), "slot file", "cannot be opened: " + why);
  }
  kept_ = named.reopen && static_cast<std::size_t>(found.st_size) == slots * slot_bytes;
  if (!kept_ && ::ftruncate(file_, 0) != 0) {
    ::close(file_);
    throw InputError(named.file.string(), "slot file",
                     std::string("cannot be emptied: ") + std::strerror(errno));
  }
  allocate(named.file.string());
}

void SlotFile::allocate(const std::string& where) {
  const std::size_t bytes = slots_ * slot_bytes_;
  const int failed = bytes == 0 ? 0 : ::posix_fallocate(file_, 0, static_cast<off_t>(bytes));
  if (failed == 0) return;
  ::close(file_);
  throw InputError(where, "slot file of " + std::to_string(bytes) + " bytes",
                   std::string(std::strerror(failed)) +
                       "; make room, set slam.slot_folder, or lower slam.max_keyframes or slam.max_pairs");
}

bool SlotFile::sync() {
  return ::fdatasync(file_) == 0;
}

SlotFile::~SlotFile() {
  ::close(file_);
}

bool SlotFile::write(std::size_t slot, std::span<const std::uint8_t> data) {
  return fits(slot, data.size()) && whole(::pwrite, file_, data.data(), data.size(), slot * slot_bytes_);
}

bool SlotFile::read(std::size_t slot, std::span<std::uint8_t> data) {
  return fits(slot, data.size()) && whole(::pread, file_, data.data(), data.size(), slot * slot_bytes_);
}

}  // namespace fathom::onboard
