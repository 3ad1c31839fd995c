#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace fathom::io {

// Finds the binary ensembles of one format (PD0, or PD4 and PD5) in a stream of bytes cut anywhere: from a
// serial line, a file or datagrams. Each ends in the sum of all its bytes before modulo 65536, little endian.
// After damage the search continues one byte behind the bad header, so that a good ensemble inside a damaged
// length is still found. Does no input or output itself; all memory is taken at construction.
class EnsembleStream {
 public:
  static constexpr std::size_t kChecksumBytes = 2;

  struct Counts {
    std::uint64_t good = 0;           // ensembles given out
    std::uint64_t bad_checksum = 0;   // consistent headers with a wrong checksum
    std::uint64_t malformed = 0;      // checksum right, but the fields make no sense
    std::uint64_t truncated = 0;      // cut off by the end of the input
    std::uint64_t resynced = 0;       // times that an ensemble was found after bytes had to be skipped
    std::uint64_t skipped_bytes = 0;  // that belong to no ensemble with a right checksum
  };

  // Whether an ensemble of at most `longest` bytes, checksum included, may begin with `bytes`.
  struct Header {
    enum class State : std::uint8_t { kNone, kIncomplete, kPossible };
    State state = State::kNone;
    std::size_t size = 0;  // of the ensemble, checksum included; 0: not known yet
  };
  using ReadHeader = Header (*)(std::span<const std::uint8_t> bytes, std::size_t longest) noexcept;

  EnsembleStream(std::uint8_t first_byte, std::size_t longest, ReadHeader read_header);

  // Copies as many bytes as there is room for and returns how many. After next() has returned nothing there
  // is always room for at least one byte.
  [[nodiscard]] std::size_t accept(std::span<const std::uint8_t> bytes) noexcept;
  // The next ensemble with a right checksum, checksum included, valid until the next accept(); empty when
  // more bytes are needed.
  [[nodiscard]] std::span<const std::uint8_t> next() noexcept;
  // No more bytes will come: next() then also searches in what waits for its end.
  void finish() noexcept { finishing_ = true; }

  // Bytes accepted and not yet part of an ensemble that was given out, nor skipped.
  [[nodiscard]] std::size_t pendingBytes() const noexcept { return end_ - begin_; }

  // `good` and `malformed` are counted by the reader of the fields.
  [[nodiscard]] Counts& counts() noexcept { return counts_; }
  [[nodiscard]] const Counts& counts() const noexcept { return counts_; }

 private:
  void skip(std::size_t bytes) noexcept;

  std::uint8_t first_byte_;
  std::size_t longest_;
  ReadHeader read_header_;
  std::vector<std::uint8_t> buffer_;
  std::size_t begin_ = 0, end_ = 0;  // of the bytes not yet consumed
  bool skipping_ = false, finishing_ = false;
  Counts counts_;
};

}  // namespace fathom::io
