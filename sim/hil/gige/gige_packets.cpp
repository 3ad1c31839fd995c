#include "sim/hil/gige/gige_packets.hpp"

#include <algorithm>

namespace fathom::sim {
namespace {

constexpr std::uint8_t kKey = 0x42;          // every request begins with it
constexpr std::uint8_t kWantsAnswer = 0x01;  // flag
constexpr std::size_t kGvcpHeaderBytes = 8;
constexpr std::uint32_t kLeader = 1, kTrailer = 2, kData = 3;  // GVSP packet formats
constexpr std::uint16_t kImage = 1;                            // GVSP payload type

}  // namespace

std::uint32_t bigEndian32(std::span<const std::uint8_t> bytes, std::size_t at) {
  return std::uint32_t{bytes[at]} << 24 | std::uint32_t{bytes[at + 1]} << 16 |
         std::uint32_t{bytes[at + 2]} << 8 | bytes[at + 3];
}

std::uint16_t bigEndian16(std::span<const std::uint8_t> bytes, std::size_t at) {
  return static_cast<std::uint16_t>(bytes[at] << 8 | bytes[at + 1]);
}

void putBigEndian32(std::vector<std::uint8_t>& out, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) out.push_back(static_cast<std::uint8_t>(value >> shift));
}

void putBigEndian16(std::vector<std::uint8_t>& out, std::uint16_t value) {
  out.push_back(static_cast<std::uint8_t>(value >> 8));
  out.push_back(static_cast<std::uint8_t>(value));
}

std::optional<GvcpRequest> parseGvcp(std::span<const std::uint8_t> datagram) {
  if (datagram.size() < kGvcpHeaderBytes || datagram[0] != kKey) return std::nullopt;
  const std::size_t length = bigEndian16(datagram, 4);
  if (length > datagram.size() - kGvcpHeaderBytes) return std::nullopt;
  return GvcpRequest{.command = bigEndian16(datagram, 2),
                     .id = bigEndian16(datagram, 6),
                     .wants_answer = (datagram[1] & kWantsAnswer) != 0,
                     .payload = datagram.subspan(kGvcpHeaderBytes, length)};
}

std::vector<std::uint8_t> gvcpAnswer(const GvcpRequest& request, GvcpStatus status,
                                     std::span<const std::uint8_t> payload) {
  std::vector<std::uint8_t> out;
  putBigEndian16(out, static_cast<std::uint16_t>(status));
  putBigEndian16(
      out, static_cast<std::uint16_t>(request.command + 1));  // every answer is its request's number + 1
  putBigEndian16(out, static_cast<std::uint16_t>(payload.size()));
  putBigEndian16(out, request.id);
  out.insert(out.end(), payload.begin(), payload.end());
  return out;
}

void GvspFrame::packet(std::uint32_t n, std::vector<std::uint8_t>& out) const {
  out.clear();
  const std::uint32_t last = packets() - 1;
  putBigEndian16(out, 0);  // status
  putBigEndian16(out, id);
  putBigEndian32(out, (n == 0 ? kLeader : n == last ? kTrailer : kData) << 24 | n);
  if (n == 0) {
    putBigEndian16(out, 0);
    putBigEndian16(out, kImage);
    putBigEndian32(out, static_cast<std::uint32_t>(ticks >> 32));
    putBigEndian32(out, static_cast<std::uint32_t>(ticks));
    for (const std::uint32_t field : {pixel_format, width, height, 0U, 0U}) putBigEndian32(out, field);
    putBigEndian32(out, 0);  // padding of lines and of the image
  } else if (n == last) {
    putBigEndian16(out, 0);
    putBigEndian16(out, kImage);
    putBigEndian32(out, height);
  } else {
    const std::size_t from = (n - 1) * data_bytes;
    const std::size_t to = std::min(from + data_bytes, image.size());
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(image.data());
    out.insert(out.end(), bytes + from, bytes + to);
  }
}

}  // namespace fathom::sim
