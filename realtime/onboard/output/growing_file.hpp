#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "realtime/kernel/descriptor.hpp"

namespace fathom::onboard {

// A file that grows row by row on a disk that may refuse for a while. Rows wait in a buffer that is taken at
// once, and are written at an offset that the object keeps: what the disk refuses stays in the buffer and is
// tried again. While the buffer is full and the disk refuses, rows are lost: whole ones, counted; the file is
// then not what it should be, also when the disk works again. After construction nothing throws and nothing
// is allocated; a write may wait for the disk.
class GrowingFile {
 public:
  static constexpr std::size_t kBufferBytes = 256 * 1024;
  // Rows are written when so many bytes wait; a disk that refused is tried again after as many more.
  static constexpr std::size_t kWriteBytes = 16 * 1024;

  // `room`: of the disk, taken when the file is opened, if the file system can; others cannot fill it [B].
  explicit GrowingFile(std::filesystem::path path, std::uint64_t room = 0);

  // Opens what is there, or a new file, and goes on behind its end; throws std::runtime_error when it cannot.
  void open();
  // The file is there, or will be once the disk takes it: it was opened, or rows were added.
  [[nodiscard]] bool begun() const { return begun_; }

  // A row; longer ones than the buffer are lost.
  void add(std::span<const std::uint8_t> row) noexcept;
  // Writes all that waits; false when the disk refuses, or rows were lost.
  bool flush() noexcept;

  // Rows included that wait [B].
  [[nodiscard]] std::uint64_t size() const { return written_ + waiting_; }
  [[nodiscard]] std::size_t waiting() const { return waiting_; }
  [[nodiscard]] std::uint64_t lostRows() const { return lost_rows_; }
  // Of the last write, or of the rows that were lost; "" when well.
  [[nodiscard]] std::string failure() const;

  // Back to what it was when it had so many bytes and had lost so many rows, or had not begun. False when it
  // is shorter than that, or the disk refuses.
  [[nodiscard]] bool cutBack(bool begun, std::uint64_t bytes, std::uint64_t lost_rows) noexcept;
  // All of it, rows that wait too; what cannot be read is left out and said.
  [[nodiscard]] std::vector<std::uint8_t> read();
  // Flushed, as long as its rows are (room that was taken goes back), and on the disk. False: see failure().
  [[nodiscard]] bool finish() noexcept;

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  // These do not throw; false when the disk refuses.
  bool makeOpen() noexcept;
  bool takeUp() noexcept;
  bool refused() noexcept;
  void takeRoom() noexcept;

  std::filesystem::path path_;
  std::uint64_t room_;
  Descriptor file_;
  bool begun_ = false;
  std::uint64_t written_ = 0;  // [B]; the offset of the next write
  std::vector<std::uint8_t> buffer_;
  std::size_t waiting_ = 0;      // of the buffer [B]
  std::size_t until_write_ = 0;  // bytes to be added before the disk is tried [B]
  std::uint64_t lost_rows_ = 0;
  int error_ = 0;  // errno of the last write; 0: it went well
};

}  // namespace fathom::onboard
