#pragma once

#include <cstdint>
#include <filesystem>
#include <ostream>
#include <span>
#include <streambuf>
#include <string>
#include <vector>

#include "realtime/base/files/descriptor.hpp"

namespace fathom::onboard {

// A stream into memory for one row at a time; reused for the next row, it keeps its buffer and its format.
class RowStream : public std::ostream {
 public:
  RowStream() : std::ostream(nullptr) { rdbuf(&buffer_); }

  RowStream& begin() {
    buffer_.text.clear();
    return *this;
  }
  [[nodiscard]] std::span<const std::uint8_t> row() const {
    return {reinterpret_cast<const std::uint8_t*>(buffer_.text.data()), buffer_.text.size()};
  }

 private:
  struct Buffer : std::streambuf {
    int_type overflow(int_type c) override {
      if (!traits_type::eq_int_type(c, traits_type::eof())) text.push_back(traits_type::to_char_type(c));
      return traits_type::not_eof(c);
    }
    std::streamsize xsputn(const char* from, std::streamsize count) override {
      text.append(from, static_cast<std::size_t>(count));
      return count;
    }
    std::string text;
  };
  Buffer buffer_;
};

// A file that grows row by row on a disk that may refuse for a while. Rows wait in a preallocated buffer and
// are written at an offset that the object keeps; rows that the disk refuses stay in the buffer and are tried
// again. While the buffer is full and the disk refuses, whole rows are lost and counted; the file is then
// incomplete, also when the disk works again. After construction nothing throws and nothing is allocated; a
// write may wait for the disk.
class GrowingFile {
 public:
  static constexpr std::size_t kBufferBytes = 256 * 1024;
  // Rows are written when so many bytes wait; a disk that refused is tried again after as many more.
  static constexpr std::size_t kWriteBytes = 16 * 1024;

  // `room`: disk space reserved when the file is opened, if the file system can [B].
  explicit GrowingFile(std::filesystem::path path, std::uint64_t room = 0);

  // Opens the file and continues at its end, or makes a new one; throws std::runtime_error when it cannot.
  void open();
  // The file exists, or will once the disk permits: it was opened, or rows were added.
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

  // Truncates the file to an earlier state: so many bytes, so many rows lost, or not begun. False when it is
  // shorter than that, or the disk refuses.
  [[nodiscard]] bool cutBack(bool begun, std::uint64_t bytes, std::uint64_t lost_rows) noexcept;
  // The whole content, waiting rows included; what cannot be read is left out, and failure() reports it.
  [[nodiscard]] std::vector<std::uint8_t> read();
  // Writes the waiting rows, truncates reserved space and flushes the file to the disk. False: see failure().
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
