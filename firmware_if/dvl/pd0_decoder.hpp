#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "firmware_if/dvl/pd0_ensemble.hpp"

namespace fathom::io {

// Finds PD0 ensembles in a stream of bytes cut anywhere: from a serial line, a file or datagrams. Does no
// input or output itself. All memory is taken at construction; feeding and decoding allocate nothing.
//
// An ensemble counts only if its header is consistent (length and offset table) and its checksum, the sum of
// all its bytes modulo 65536, is right. After damage the search goes on one byte behind the bad header, so
// that a good ensemble inside a damaged length is still found. A damaged length can delay the ensembles
// behind it by at most `max_ensemble_bytes`.
class Pd0Decoder {
 public:
  struct Config {
    // Longest ensemble taken as possible [bytes]. 255 cells of velocity, correlation, intensity and percent
    // good with all leaders need about 5.3 kB.
    std::size_t max_ensemble_bytes = 8192;
  };
  struct Counts {
    std::uint64_t good = 0;           // ensembles given out
    std::uint64_t bad_checksum = 0;   // consistent headers whose checksum was wrong
    std::uint64_t malformed = 0;      // checksum right, but no fixed or variable leader
    std::uint64_t truncated = 0;      // cut off by the end of the input
    std::uint64_t resynced = 0;       // times that an ensemble was found after bytes had to be skipped
    std::uint64_t skipped_bytes = 0;  // that belong to no ensemble with a right checksum
  };

  Pd0Decoder() : Pd0Decoder(Config{}) {}
  explicit Pd0Decoder(const Config& config);

  // Copies as many bytes as there is room for and returns how many. After next() has returned nullptr there
  // is always room for at least one byte.
  [[nodiscard]] std::size_t accept(std::span<const std::uint8_t> bytes) noexcept;

  // The next ensemble in the bytes accepted so far, valid until the next call; nullptr when more bytes are
  // needed.
  [[nodiscard]] const Pd0Ensemble* next() noexcept;

  // The bytes of the ensemble that next() gave last, header to checksum; valid until the next accept().
  [[nodiscard]] std::span<const std::uint8_t> rawEnsemble() const noexcept { return raw_; }

  // Bytes accepted and not yet part of an ensemble that was given out, nor skipped.
  [[nodiscard]] std::size_t pendingBytes() const noexcept { return end_ - begin_; }

  // Says that no more bytes will come: next() then also searches what waits for its end.
  void finish() noexcept { finishing_ = true; }

  // Feeds all of `bytes` and calls `on_ensemble(const Pd0Ensemble&)` for each ensemble found.
  template <class OnEnsemble>
  void feed(std::span<const std::uint8_t> bytes, OnEnsemble&& on_ensemble) {
    do {
      bytes = bytes.subspan(accept(bytes));
      while (const Pd0Ensemble* ensemble = next()) on_ensemble(*ensemble);
    } while (!bytes.empty());
  }
  // finish(), then the ensembles that were still waiting.
  template <class OnEnsemble>
  void drain(OnEnsemble&& on_ensemble) {
    finish();
    while (const Pd0Ensemble* ensemble = next()) on_ensemble(*ensemble);
  }

  [[nodiscard]] const Counts& counts() const noexcept { return counts_; }

 private:
  enum class Candidate : std::uint8_t { kNone, kIncomplete, kWhole };
  [[nodiscard]] Candidate inspectHeader(std::size_t& length) const noexcept;
  void skip(std::size_t bytes) noexcept;

  std::size_t max_ensemble_bytes_;
  std::vector<std::uint8_t> buffer_;
  std::size_t begin_ = 0;  // of the bytes not yet consumed
  std::size_t end_ = 0;
  bool skipping_ = false;
  bool finishing_ = false;
  Pd0Ensemble ensemble_;
  std::span<const std::uint8_t> raw_;
  Counts counts_;
};

}  // namespace fathom::io
