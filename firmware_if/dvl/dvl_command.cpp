#include "firmware_if/dvl/dvl_command.hpp"

#include <algorithm>
#include <array>
#include <cinttypes>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "firmware_if/dvl/dvl_sample.hpp"
#include "firmware_if/dvl/pd0_decoder.hpp"
#include "firmware_if/files/byte_file.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::io {
namespace {

constexpr std::size_t kReadBytes = 64 * 1024;

// An absent value is an empty field. `decimals` is the resolution on the wire, so nothing is rounded away.
void field(std::FILE* out, const std::optional<double>& value, int decimals) {
  if (value) {
    std::fprintf(out, ",%.*f", decimals, *value);
  } else {
    std::fputc(',', out);
  }
}

void csvHeader(std::FILE* out) {
  std::fputs(
      "ensemble,utc_ns,frame,v1_mps,v2_mps,v3_mps,v4_mps,range1_m,range2_m,range3_m,range4_m,heading_deg,"
      "pitch_deg,"
      "roll_deg,sound_speed_mps\n",
      out);
}

void csvRow(std::FILE* out, const Pd0Ensemble& ensemble) {
  const Pd0BottomTrack track = ensemble.bottom_track.value_or(Pd0BottomTrack{});
  std::fprintf(out, "%" PRIu32 ",", ensemble.number);
  if (ensemble.utc_ns) std::fprintf(out, "%" PRId64, *ensemble.utc_ns);
  std::fprintf(out, ",%s", frameName(ensemble.frame));
  for (const auto& velocity : track.velocity) field(out, velocity, 3);
  for (const auto& range : track.range) field(out, range, 2);
  field(out, ensemble.heading_deg, 2);
  field(out, ensemble.pitch_deg, 2);
  field(out, ensemble.roll_deg, 2);
  field(out, ensemble.sound_speed, 0);
  std::fputc('\n', out);
}

// What a person wants to know of a capture before trusting it.
class Summary {
 public:
  void add(const Pd0Ensemble& ensemble) {
    if (ensembles_++ == 0) first_ = ensemble;
    last_ = ensemble;
    if (ensemble.hasBottomTrackVelocity()) ++with_velocity_;
    if (ensemble.up_looking) ++up_looking_;
    const auto sample = toDvlSample(ensemble);
    if (!sample) return;
    if (sample->altitude) altitude_.add(*sample->altitude);
    if (sample->velocity) speed_.add(sample->velocity->norm());
  }

  void print(std::FILE* out) const {
    std::fprintf(out, "ensembles            %" PRIu64 " (%" PRIu32 " to %" PRIu32 ")\n", ensembles_,
                 first_.number, last_.number);
    std::fprintf(out, "with bottom track    %" PRIu64 "\n", with_velocity_);
    if (first_.utc_ns && last_.utc_ns) {
      std::fprintf(out, "from, for            %.2f s UTC, %.2f s\n",
                   static_cast<double>(*first_.utc_ns) * 1e-9,
                   static_cast<double>(*last_.utc_ns - *first_.utc_ns) * 1e-9);
    }
    std::fprintf(out, "frame                %s%s\n", frameName(first_.frame),
                 first_.tilts_used ? " (tilts used)" : "");
    std::fprintf(out, "firmware, beams      %d.%d, %d beams\n", first_.firmware_version,
                 first_.firmware_revision, first_.beams);
    std::fprintf(out, "profile looks up     %" PRIu64 "\n", up_looking_);
    altitude_.print(out, "altitude [m]        ");
    speed_.print(out, "speed [m/s]         ");
  }

 private:
  struct Extent {
    double low = std::numeric_limits<double>::infinity();
    double high = -std::numeric_limits<double>::infinity();
    void add(double value) {
      low = std::min(low, value);
      high = std::max(high, value);
    }
    void print(std::FILE* out, const char* label) const {
      if (low <= high) std::fprintf(out, "%s %.2f to %.2f\n", label, low, high);
    }
  };
  std::uint64_t ensembles_ = 0;
  std::uint64_t with_velocity_ = 0;
  std::uint64_t up_looking_ = 0;
  Pd0Ensemble first_;
  Pd0Ensemble last_;
  Extent altitude_;
  Extent speed_;
};

}  // namespace

int runDvlCommand(const DvlCommand& command, std::FILE* out, std::FILE* report) {
  ByteFile file(command.file);
  Pd0Decoder decoder;
  Summary summary;
  const auto take = [&](const Pd0Ensemble& ensemble) {
    summary.add(ensemble);
    if (!command.csv) return;
    if (decoder.counts().good == 1) csvHeader(out);
    csvRow(out, ensemble);
  };

  std::vector<std::uint8_t> buffer(kReadBytes);
  while (const std::size_t got = file.read(buffer)) decoder.feed({buffer.data(), got}, take);
  decoder.drain(take);

  const Pd0Decoder::Counts& counts = decoder.counts();
  if (counts.good == 0) {
    throw InputError(command.file.string(), "",
                     "holds no PD0 ensemble with a right checksum; give a binary RDI PD0 capture");
  }
  if (!command.csv) summary.print(out);
  if (std::fflush(out) != 0 || std::ferror(out) != 0)
    throw std::runtime_error("the output could not be written");
  std::fprintf(report,
               "good %" PRIu64 ", bad-checksum %" PRIu64 ", resynced %" PRIu64 ", malformed %" PRIu64
               ", truncated %" PRIu64 ", skipped %" PRIu64 " bytes\n",
               counts.good, counts.bad_checksum, counts.resynced, counts.malformed, counts.truncated,
               counts.skipped_bytes);
  return kExitSuccess;
}

}  // namespace fathom::io
