#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "firmware_if/devices/byte_stream.hpp"
#include "firmware_if/devices/dvl/pd0_decoder.hpp"
#include "firmware_if/devices/dvl/pd45_decoder.hpp"
#include "firmware_if/devices/dvl/pd6_decoder.hpp"
#include "firmware_if/devices/sample_source.hpp"
#include "firmware_if/devices/vehicle_time.hpp"
#include "realtime/base/config_keys.hpp"

namespace fathom::io {

// Table `[dvl]` of onboard.toml.
struct DvlConfig {
  enum class Format { kAuto, kPd0, kPd4, kPd5, kPd6 };
  enum class Clock {
    kInstrument,  // the ensemble's own stamp, its clock followed against the vehicle's
    kArrival,     // when the first byte came
  };
  std::string device;  // serial:DEVICE:BAUD, udp:HOST:PORT to listen on, file:PATH; empty: no DVL
  Format format = Format::kAuto;
  Clock clock = Clock::kInstrument;
  double latency_s = 0.1;  // least time from the first ping to the ensemble's first byte here
  double silence_s = 2;    // without an ensemble for so long: a silence, counted
};
// Its keys.
void visitDvl(KeyVisitor& keys, DvlConfig& config);

// A Teledyne RDI DVL as it runs: bytes in, DvlSample and raw ensembles ("RAW_DVL") out. Its format is as
// configured, or recognised by the first whole ensemble (and again after a silence). Ensembles without bottom
// track give no sample, and are counted and kept raw. Takes no memory after construction.
class DvlSource final : public SampleSource {
 public:
  // Throws InputError for a device that can never be used; a serial line that is not there is waited for.
  DvlSource(const DvlConfig& config, VehicleTime now);
  // The same over a stream that is given: tests, predive.
  DvlSource(const DvlConfig& config, VehicleTime now, std::unique_ptr<ByteStream> stream);

  bool poll(int timeout_ms, SampleSink& sink) override;
  [[nodiscard]] DeviceHealth health() const override;

  // The format found; kAuto: none yet.
  [[nodiscard]] DvlConfig::Format format() const noexcept { return format_; }
  [[nodiscard]] const DeviceClock& clock() const noexcept { return clock_; }

 private:
  // One of the last reads: when its bytes came.
  struct Chunk {
    std::uint64_t begin = 0;  // position of its first byte in the stream
    std::int64_t arrival_ns = 0;
  };
  static constexpr std::size_t kChunks = 256;

  void takeBytes(std::span<const std::uint8_t> bytes, std::int64_t arrival_ns, SampleSink& sink) noexcept;
  void ensemble(DvlConfig::Format format, std::span<const std::uint8_t> raw, std::uint64_t first_byte,
                std::int64_t arrival_ns, const std::optional<std::int64_t>& stamp,
                const std::optional<DvlSample>& sample, SampleSink& sink) noexcept;
  [[nodiscard]] std::int64_t arrivalOf(std::uint64_t position) const noexcept;
  [[nodiscard]] bool reads(DvlConfig::Format format) const noexcept;

  DvlConfig config_;
  VehicleTime now_;
  std::unique_ptr<ByteStream> stream_;
  DvlConfig::Format format_;
  DeviceClock clock_;
  Pd0Decoder pd0_;
  Pd45Decoder pd45_;
  Pd6Decoder pd6_;
  std::array<std::uint8_t, 4096> buffer_{};
  std::array<Chunk, kChunks> chunks_{};
  std::uint64_t chunk_count_ = 0, position_ = 0;  // reads and bytes so far
  std::int64_t last_ensemble_ns_ = 0, last_sample_ns_ = 0;
  bool silent_ = false;
  std::uint64_t samples_ = 0, ensembles_ = 0, no_bottom_track_ = 0, no_velocity_ = 0, no_time_ = 0,
                silences_ = 0;
};

}  // namespace fathom::io
