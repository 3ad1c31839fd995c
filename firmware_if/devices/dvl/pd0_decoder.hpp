#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware_if/devices/dvl/ensemble_stream.hpp"
#include "firmware_if/devices/dvl/pd0_ensemble.hpp"

namespace fathom::io {

// Finds and reads PD0 ensembles in a stream of bytes (EnsembleStream). An ensemble counts only if its header
// is consistent (length and offset table) and its checksum is right. A damaged length can delay the ensembles
// behind it by at most `max_ensemble_bytes`. Feeding and decoding allocate nothing.
class Pd0Decoder {
 public:
  struct Config {
    // Longest ensemble taken as possible [bytes]. 255 cells of velocity, correlation, intensity and percent
    // good with all leaders need about 5.3 kB.
    std::size_t max_ensemble_bytes = 8192;
  };
  using Counts = EnsembleStream::Counts;  // malformed: no fixed or no variable leader

  Pd0Decoder() : Pd0Decoder(Config{}) {}
  explicit Pd0Decoder(const Config& config);

  // As those of EnsembleStream.
  [[nodiscard]] std::size_t accept(std::span<const std::uint8_t> bytes) noexcept {
    return stream_.accept(bytes);
  }
  void finish() noexcept { stream_.finish(); }
  [[nodiscard]] std::size_t pendingBytes() const noexcept { return stream_.pendingBytes(); }
  [[nodiscard]] const Counts& counts() const noexcept { return stream_.counts(); }

  // The next ensemble in the bytes accepted so far, valid until the next call; nullptr when more bytes are
  // needed.
  [[nodiscard]] const Pd0Ensemble* next() noexcept;
  // The bytes of the ensemble that next() gave last, header to checksum; valid until the next accept().
  [[nodiscard]] std::span<const std::uint8_t> rawEnsemble() const noexcept { return raw_; }

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

 private:
  EnsembleStream stream_;
  Pd0Ensemble ensemble_;
  std::span<const std::uint8_t> raw_;
};

}  // namespace fathom::io
