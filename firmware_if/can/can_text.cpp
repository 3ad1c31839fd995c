#include "firmware_if/can/can_text.hpp"

#include "firmware_if/can/candump.hpp"
#include "firmware_if/can/gateway_text.hpp"

namespace fathom::io {

CanLine CanTextReader::readLine(std::string_view line) noexcept {
  line = trim(line);
  if (line.empty() || line.front() == '#') return CanLine::kBlank;
  if (isCanboatLine(line)) {
    const CanLine kind = parseCanboatLine(line, frame_, packet_);
    whole_ = whole_ || kind == CanLine::kPacket;
    return whole_ && kind == CanLine::kFrame ? CanLine::kPacket : kind;
  }
  if (isYachtDevicesLine(line)) return parseYachtDevicesLine(line, frame_);
  if (isActisenseLine(line)) return parseActisenseLine(line, packet_);
  return parseCandumpLine(line, frame_);
}

CanLine CanTextReader::endLine() noexcept {
  const CanLine kind = size_ > line_.size() ? CanLine::kBroken : readLine({line_.data(), size_});
  size_ = 0;
  counts_.frames += kind == CanLine::kFrame;
  counts_.packets += kind == CanLine::kPacket;
  counts_.other += kind == CanLine::kOther;
  counts_.broken += kind == CanLine::kBroken;
  return kind;
}

}  // namespace fathom::io
