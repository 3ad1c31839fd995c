#include <openjpeg.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <memory>
#include <optional>

#include "realtime/base/units.hpp"
#include "telemetry/monitor/codec/peers/lattice.hpp"

namespace fathom::peers {
namespace {

struct Memory {
  std::vector<std::uint8_t> bytes;
  std::size_t at = 0;
};

OPJ_SIZE_T writeTo(void* from, OPJ_SIZE_T count, void* user) {
  auto& memory = *static_cast<Memory*>(user);
  if (memory.at + count > memory.bytes.size()) memory.bytes.resize(memory.at + count);
  std::memcpy(memory.bytes.data() + memory.at, from, count);
  memory.at += count;
  return count;
}
OPJ_SIZE_T readFrom(void* to, OPJ_SIZE_T count, void* user) {
  auto& memory = *static_cast<Memory*>(user);
  const std::size_t left = memory.bytes.size() - memory.at;
  if (left == 0) return static_cast<OPJ_SIZE_T>(-1);
  const std::size_t n = std::min<std::size_t>(count, left);
  std::memcpy(to, memory.bytes.data() + memory.at, n);
  memory.at += n;
  return n;
}
OPJ_OFF_T skip(OPJ_OFF_T count, void* user) {
  static_cast<Memory*>(user)->at += static_cast<std::size_t>(count);
  return count;
}
OPJ_BOOL seek(OPJ_OFF_T to, void* user) {
  static_cast<Memory*>(user)->at = static_cast<std::size_t>(to);
  return OPJ_TRUE;
}

struct Release {
  void operator()(opj_codec_t* p) const { opj_destroy_codec(p); }
  void operator()(opj_image_t* p) const { opj_image_destroy(p); }
};
using Image = std::unique_ptr<opj_image_t, Release>;

opj_stream_t* stream(Memory& memory, bool input) {
  opj_stream_t* s = opj_stream_default_create(input ? OPJ_TRUE : OPJ_FALSE);
  opj_stream_set_user_data(s, &memory, nullptr);
  opj_stream_set_user_data_length(s, memory.bytes.size());
  opj_stream_set_write_function(s, writeTo);
  opj_stream_set_read_function(s, readFrom);
  opj_stream_set_skip_function(s, skip);
  opj_stream_set_seek_function(s, seek);
  return s;
}

// One component of whole numbers from 0 as a raw codestream; quality 0 is the reversible 5/3, otherwise 9/7
// at so many dB.
std::optional<Memory> encodeImage(const std::vector<int>& values, int rows, int cols, int bits,
                                  int resolutions, float quality) {
  opj_image_cmptparm_t form{};
  form.dx = form.dy = 1;
  form.w = static_cast<OPJ_UINT32>(cols);
  form.h = static_cast<OPJ_UINT32>(rows);
  form.prec = static_cast<OPJ_UINT32>(bits);
  Image image(opj_image_create(1, &form, OPJ_CLRSPC_GRAY));
  if (!image) return std::nullopt;
  image->x1 = form.w;
  image->y1 = form.h;
  std::copy(values.begin(), values.end(), image->comps[0].data);
  opj_cparameters_t parameters;
  opj_set_default_encoder_parameters(&parameters);
  parameters.tcp_numlayers = 1;
  parameters.numresolution = resolutions;
  if (quality > 0) {
    parameters.irreversible = 1;
    parameters.cp_fixed_quality = 1;
    parameters.tcp_distoratio[0] = quality;
  } else {
    parameters.cp_disto_alloc = 1;
    parameters.tcp_rates[0] = 0;
  }
  const std::unique_ptr<opj_codec_t, Release> codec(opj_create_compress(OPJ_CODEC_J2K));
  Memory memory;
  if (!codec || opj_setup_encoder(codec.get(), &parameters, image.get()) == OPJ_FALSE) return std::nullopt;
  opj_stream_t* out = stream(memory, false);
  const bool good = opj_start_compress(codec.get(), image.get(), out) == OPJ_TRUE &&
                    opj_encode(codec.get(), out) == OPJ_TRUE &&
                    opj_end_compress(codec.get(), out) == OPJ_TRUE;
  opj_stream_destroy(out);
  if (!good) return std::nullopt;
  return memory;
}

std::optional<std::vector<int>> decodeImage(Memory memory) {
  memory.at = 0;
  const std::unique_ptr<opj_codec_t, Release> codec(opj_create_decompress(OPJ_CODEC_J2K));
  opj_dparameters_t parameters;
  opj_set_default_decoder_parameters(&parameters);
  if (!codec || opj_setup_decoder(codec.get(), &parameters) == OPJ_FALSE) return std::nullopt;
  opj_stream_t* in = stream(memory, true);
  opj_image_t* raw = nullptr;
  const bool good =
      opj_read_header(in, codec.get(), &raw) == OPJ_TRUE && opj_decode(codec.get(), in, raw) == OPJ_TRUE;
  opj_stream_destroy(in);
  const Image image(raw);
  if (!good || !image) return std::nullopt;
  const opj_image_comp_t& c = image->comps[0];
  return std::vector<int>(c.data, c.data + std::size_t{c.w} * c.h);
}

struct Whole {
  std::vector<int> values;
  double least = 0, step = 0;  // [m]
  int bits = 1;
};
Whole quantise(const Lattice& lattice, double step) {
  Whole out;
  out.step = step;
  out.least = static_cast<double>(*std::min_element(lattice.depth.begin(), lattice.depth.end()));
  int most = 0;
  for (const float z : lattice.depth) {
    out.values.push_back(static_cast<int>(std::lround((static_cast<double>(z) - out.least) / step)));
    most = std::max(most, out.values.back());
  }
  while (out.bits < 24 && (1 << out.bits) <= most) ++out.bits;
  return out;
}
std::vector<float> heights(const Whole& whole, const std::vector<int>& values) {
  std::vector<float> out;
  out.reserve(values.size());
  for (const int v : values) out.push_back(static_cast<float>(whole.least + v * whole.step));
  return out;
}

constexpr int kMostResolutions = 6;

// Keeps the setting if it decodes within the error and is shorter; true if it held the error.
bool consider(const Lattice& lattice, const Whole& whole, int resolutions, float quality, std::size_t mask,
              double max_error, PeerResult& best) {
  const auto start = std::chrono::steady_clock::now();
  const auto memory = encodeImage(whole.values, lattice.rows, lattice.cols, whole.bits, resolutions, quality);
  const double ms = 1e3 * rt::secondsSince(start);
  const auto values = memory ? decodeImage(*memory) : std::nullopt;
  if (!values || values->size() != lattice.depth.size()) return false;
  const Errors e = errors(lattice, heights(whole, *values));
  if (e.max > max_error) return false;
  const std::size_t bytes = memory->bytes.size() + mask;
  if (best.bytes == 0 || bytes < best.bytes)
    best = {best.name,
            std::to_string(resolutions) + " resolutions" +
                (quality > 0 ? ", " + std::to_string(quality) + " dB" : "") + ", mask " +
                std::to_string(mask) + " B",
            bytes,
            e.max,
            e.rms,
            ms,
            e.nodes};
  return true;
}

}  // namespace

PeerResult jpeg2000Reversible(const Lattice& lattice, double max_error) {
  PeerResult best{"JPEG 2000 5/3", "", 0, 0, 0, 0, 0};
  const Whole whole = quantise(filled(lattice), 2 * max_error * (1 - 1e-6));
  const std::size_t mask = maskBytes(lattice);
  for (int resolutions = 1; resolutions <= kMostResolutions; ++resolutions)
    consider(lattice, whole, resolutions, 0, mask, max_error, best);
  return best;
}

PeerResult jpeg2000Irreversible(const Lattice& lattice, double max_error) {
  PeerResult best{"JPEG 2000 9/7", "", 0, 0, 0, 0, 0};
  const Whole whole = quantise(filled(lattice), max_error / 16);  // fine against the error
  const std::size_t mask = maskBytes(lattice);
  for (int resolutions = 2; resolutions <= kMostResolutions; ++resolutions) {
    float low = 10, high = 90;  // dB: too coarse, fine enough
    for (int k = 0; k < 12; ++k) {
      const float middle = (low + high) / 2;
      (consider(lattice, whole, resolutions, middle, mask, max_error, best) ? high : low) = middle;
    }
  }
  return best;
}

}  // namespace fathom::peers
