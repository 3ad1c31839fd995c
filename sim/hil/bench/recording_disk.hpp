#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace fathom::sim {

// A disk of its own for the recording, so that it can be filled without hurting anyone: an ext4 file system
// in a file, mounted where the recording goes, seen by this process and its children only. What was recorded
// stays: close() puts it where the mount was.
class RecordingDisk {
 public:
  RecordingDisk() = default;
  ~RecordingDisk();
  RecordingDisk(const RecordingDisk&) = delete;
  RecordingDisk& operator=(const RecordingDisk&) = delete;

  // Mounts a disk at the empty folder for `written` bytes and as many more as a program may take without
  // writing them (the file system is sparse); empty, or why that cannot be. Before any thread is started.
  [[nodiscard]] std::string open(const std::filesystem::path& folder, std::uint64_t written,
                                 std::uint64_t taken_unwritten);
  [[nodiscard]] bool isOpen() const { return open_; }
  // Takes all of the disk but so much; false when the disk did not let it.
  bool fill(double leave_mib);
  void makeRoom();
  // Copies what is on the disk to the folder underneath and unmounts. Throws std::runtime_error.
  void close();

 private:
  [[nodiscard]] std::filesystem::path filler() const { return folder_ / ".bench-filler"; }
  std::filesystem::path folder_, image_;
  bool open_ = false;
};

}  // namespace fathom::sim
