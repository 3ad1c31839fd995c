#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace fathom::sim {

// A separate disk for the recording, which can be filled without side effects: an ext4 file system in a file,
// mounted at the recording's folder and visible to this process and its children only. close() copies the
// recording to the folder below the mount.
class RecordingDisk {
 public:
  RecordingDisk() = default;
  ~RecordingDisk();
  RecordingDisk(const RecordingDisk&) = delete;
  RecordingDisk& operator=(const RecordingDisk&) = delete;

  // Mounts a disk at the empty folder for `written` bytes and `taken_unwritten` more, which are reserved only
  // (the file is sparse). Empty, or the reason of a failure. To be called before any thread is started.
  [[nodiscard]] std::string open(const std::filesystem::path& folder, std::uint64_t written,
                                 std::uint64_t taken_unwritten);
  [[nodiscard]] bool isOpen() const { return open_; }
  // Fills the disk except for `leave_mib`; false on failure.
  bool fill(double leave_mib);
  void makeRoom();  // undoes fill()
  // Copies what is on the disk to the folder underneath and unmounts. Throws std::runtime_error.
  void close();

 private:
  [[nodiscard]] std::filesystem::path filler() const { return folder_ / ".bench-filler"; }
  std::filesystem::path folder_, image_;
  bool open_ = false;
};

}  // namespace fathom::sim
