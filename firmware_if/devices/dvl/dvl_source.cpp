#include "firmware_if/devices/dvl/dvl_source.hpp"

#include <algorithm>
#include <cmath>

#include "firmware_if/devices/device_address.hpp"
#include "firmware_if/devices/dvl/dvl_sample.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

using Format = DvlConfig::Format;

constexpr double kStampResolution = 0.01;  // of every format [s]
// A flood of bytes must not hold the thread: the rest waits for the next poll.
constexpr int kMaxReads = 16;

std::unique_ptr<ByteStream> openDvl(const std::string& device) {
  std::string fix;
  const auto address = parseDeviceAddress(device, fix);
  if (!address) throw InputError("dvl.device " + device, "", fix);
  return openByteStream(*address);
}

}  // namespace

void visitDvl(KeyVisitor& keys, DvlConfig& c) {
  constexpr const char* kDvlFormats[] = {"auto", "pd0", "pd4", "pd5", "pd6"};
  constexpr const char* kClocks[] = {"instrument", "arrival"};
  visitDeviceAddress(keys, "device", c.device, true,
                     "serial:DEVICE:BAUD, udp:HOST:PORT to listen on, or file:PATH; empty: no DVL");
  keys.choiceOf("format", c.format, kDvlFormats, "of the ensembles");
  keys.choiceOf(
      "clock", c.clock, kClocks,
      "the ensemble's stamp, followed against the vehicle's clock, or the arrival of its first byte");
  keys.number("latency_s", c.latency_s, "s", 0, 10,
              "least time from the ping to the first byte here; taken off in both cases");
  keys.number("silence_s", c.silence_s, "s", 0.1, 3600, "without an ensemble: a silence, counted");
}

DvlSource::DvlSource(const DvlConfig& config, VehicleTime now)
    : DvlSource(config, std::move(now), openDvl(config.device)) {}

DvlSource::DvlSource(const DvlConfig& config, VehicleTime now, std::unique_ptr<ByteStream> stream)
    : config_(config),
      now_(std::move(now)),
      stream_(std::move(stream)),
      format_(config.format),
      clock_({.latency_s = config.latency_s, .resolution_s = kStampResolution}),
      last_ensemble_ns_(now_()) {}

bool DvlSource::reads(Format format) const noexcept {
  return format_ == Format::kAuto || format_ == format;
}

bool DvlSource::poll(int timeout_ms, SampleSink& sink) {
  for (int i = 0; i < kMaxReads; ++i) {
    const std::size_t size = stream_->read(buffer_, i == 0 ? timeout_ms : 0);
    if (size == 0) break;
    takeBytes({buffer_.data(), size}, now_(), sink);
  }
  const bool silent = now_() - last_ensemble_ns_ > rt::nanoseconds(config_.silence_s);
  if (silent && !silent_) {
    ++silences_;
    // The next ensemble may be of another instrument, set up otherwise.
    format_ = config_.format;
    pd6_.restart();
  }
  silent_ = silent;
  return stream_->isOpen();
}

std::int64_t DvlSource::arrivalOf(std::uint64_t position) const noexcept {
  const std::uint64_t oldest = chunk_count_ > kChunks ? chunk_count_ - kChunks : 0;
  for (std::uint64_t i = chunk_count_; i > oldest; --i) {
    const Chunk& chunk = chunks_[(i - 1) % kChunks];
    if (chunk.begin <= position || i == oldest + 1) return chunk.arrival_ns;
  }
  return 0;
}

void DvlSource::takeBytes(std::span<const std::uint8_t> bytes, std::int64_t arrival_ns,
                          SampleSink& sink) noexcept {
  chunks_[chunk_count_++ % kChunks] = {position_, arrival_ns};
  const std::uint64_t end = position_ + bytes.size();
  // Feeds a binary decoder and calls `use(found, raw, first_byte)` for each ensemble.
  const auto decode = [&](auto& decoder, const auto& use) {
    auto rest = bytes;
    do {
      rest = rest.subspan(decoder.accept(rest));
      while (const auto* found = decoder.next()) {
        const auto raw = decoder.rawEnsemble();
        use(*found, raw, end - rest.size() - decoder.pendingBytes() - raw.size());
      }
    } while (!rest.empty());
  };
  // toDvlSample() needs some time; ensemble() sets the sample's.
  const auto take = [&](Format format, Pd0Ensemble found, std::span<const std::uint8_t> raw,
                        std::uint64_t first_byte) {
    const auto stamp = found.utc_ns;
    if (!stamp) found.utc_ns = arrival_ns;
    ensemble(format, raw, first_byte, arrival_ns, stamp, toDvlSample(found), sink);
  };
  if (reads(Format::kPd0))
    decode(pd0_, [&](const Pd0Ensemble& found, auto raw, std::uint64_t first_byte) {
      take(Format::kPd0, found, raw, first_byte);
    });
  if (reads(Format::kPd4) || reads(Format::kPd5))
    decode(pd45_, [&](const Pd45Ensemble& found, auto raw, std::uint64_t first_byte) {
      take(found.pd5 ? Format::kPd5 : Format::kPd4, toPd0(found, arrival_ns), raw, first_byte);
    });
  if (reads(Format::kPd6)) {
    for (std::size_t i = 0; i < bytes.size(); ++i) {
      if (!pd6_.push(bytes[i])) continue;
      const auto raw = pd6_.rawEnsemble();
      const std::uint64_t last = position_ + i + 1;
      ensemble(Format::kPd6, raw, last - std::min<std::uint64_t>(last, raw.size()), arrival_ns,
               pd6_.ensemble().utc_ns, pd6_.ensemble().sample, sink);
    }
  }
  position_ = end;
}

void DvlSource::ensemble(Format format, std::span<const std::uint8_t> raw, std::uint64_t first_byte,
                         std::int64_t arrival_ns, const std::optional<std::int64_t>& stamp,
                         const std::optional<DvlSample>& sample, SampleSink& sink) noexcept {
  // The other decoders see the same bytes until the format is known; a PD4 in a PD5 stream is an error too.
  if (!reads(format)) return;
  format_ = format;
  ++ensembles_;
  last_ensemble_ns_ = arrival_ns;
  sink.raw(arrival_ns, "RAW_DVL", raw);
  const std::int64_t first_ns = arrivalOf(first_byte);
  // The clock is followed by every ensemble, with bottom track or without.
  std::int64_t utc_ns = first_ns - rt::nanoseconds(config_.latency_s);
  if (stamp && config_.clock == DvlConfig::Clock::kInstrument) utc_ns = clock_.vehicleNs(*stamp, first_ns);
  if (!stamp) ++no_time_;
  if (!sample) {
    ++no_bottom_track_;
    return;
  }
  DvlSample out = *sample;
  out.utc_ns = utc_ns;
  if (!out.velocity) ++no_velocity_;
  ++samples_;
  last_sample_ns_ = arrival_ns;
  sink.sample(arrival_ns, out);
}

DeviceHealth DvlSource::health() const {
  const bool pd0 = reads(Format::kPd0), pd45 = reads(Format::kPd4) || reads(Format::kPd5);
  const EnsembleStream::Counts& of_pd0 = pd0_.counts();
  const EnsembleStream::Counts& of_pd45 = pd45_.counts();
  const Pd6Decoder::Counts& of_pd6 = pd6_.counts();
  DeviceHealth health;
  health.name = "dvl";
  health.open = stream_->isOpen();
  health.reason = stream_->reason();
  health.last_data_ns = last_sample_ns_;
  health.samples = samples_;
  health.disconnects = stream_->disconnects();
  health.counters = {{"ensembles", ensembles_},
                     {"no_bottom_track", no_bottom_track_},
                     {"no_velocity", no_velocity_},
                     {"no_time", no_time_},
                     {"silences", silences_},
                     {"bad_checksum", of_pd0.bad_checksum + of_pd45.bad_checksum},
                     {"malformed", of_pd0.malformed + (format_ == Format::kPd6 ? of_pd6.bad_lines : 0)},
                     {"resynced", pd0    ? of_pd0.resynced
                                  : pd45 ? of_pd45.resynced
                                         : 0},
                     {"skipped_bytes", pd0    ? of_pd0.skipped_bytes
                                       : pd45 ? of_pd45.skipped_bytes
                                              : of_pd6.skipped_bytes},
                     {"clock_leaps", clock_.leaps()},
                     {"late", clock_.late()},
                     {"clock_offset_ms", static_cast<std::uint64_t>(std::abs(clock_.offset() * 1e3))},
                     {"bytes", position_}};
  return health;
}

}  // namespace fathom::io
