#include "telemetry/tiles/draco_values.hpp"

#include <draco/compression/decode.h>
#include <draco/compression/expert_encode.h>
#include <draco/point_cloud/point_cloud.h>

#include <algorithm>
#include <array>
#include <exception>
#include <vector>

namespace fathom::telemetry {
namespace {

// What every stream begins with in Draco's bitstream 2.3: magic, version, point cloud, sequential, no flags;
// number of points (u32, little-endian, at kPointsAt); one decoder of one attribute: generic, int16,
// components (at kComponentsAt), not normalised, id 0, integer coder; difference prediction, wrap transform,
// compressed.
constexpr std::size_t kPointsAt = 11;
constexpr std::size_t kComponentsAt = 19;
using Prefix = std::array<std::uint8_t, 26>;

Prefix prefix(std::size_t points, int components) {
  Prefix p{'D', 'R', 'A', 'C', 'O', 2, 3, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 4, 3, 0, 0, 0, 1, 0, 1, 1};
  for (std::size_t i = 0; i < 4; ++i) p[kPointsAt + i] = static_cast<std::uint8_t>(points >> (8 * i));
  p[kComponentsAt] = static_cast<std::uint8_t>(components);
  return p;
}

// Every stream ends with the wrap transform's bounds, two int32. The lesser is 0 as sent; of the greater 16
// bits go.
constexpr std::size_t kBoundsBytes = 8;
constexpr std::size_t kSentBoundBytes = 2;

std::size_t encodeCloud(std::span<const std::int16_t> values, int components, std::span<std::uint8_t> out) {
  const std::size_t points = values.size() / static_cast<std::size_t>(components);
  draco::PointCloud cloud;
  cloud.set_num_points(static_cast<std::uint32_t>(points));
  draco::GeometryAttribute form;
  form.Init(draco::GeometryAttribute::GENERIC, nullptr, static_cast<std::uint8_t>(components),
            draco::DT_INT16, false, static_cast<std::int64_t>(sizeof(std::int16_t)) * components, 0);
  const int id = cloud.AddAttribute(form, true, static_cast<std::uint32_t>(points));
  for (std::size_t k = 0; k < points; ++k)
    cloud.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(static_cast<std::uint32_t>(k)),
                                           values.data() + k * static_cast<std::size_t>(components));
  draco::ExpertEncoder encoder(cloud);
  encoder.SetEncodingMethod(draco::POINT_CLOUD_SEQUENTIAL_ENCODING);
  encoder.SetSpeedOptions(0, 0);
  draco::EncoderBuffer buffer;
  if (!encoder.EncodeToBuffer(&buffer).ok()) return 0;

  const auto* bytes = reinterpret_cast<const std::uint8_t*>(buffer.data());
  const Prefix head = prefix(points, components);
  if (buffer.size() < head.size() + kBoundsBytes || !std::equal(head.begin(), head.end(), bytes)) return 0;
  const std::uint8_t* bounds = bytes + buffer.size() - kBoundsBytes;
  const std::size_t body = buffer.size() - head.size() - kBoundsBytes;
  if (std::any_of(bounds, bounds + 4, [](std::uint8_t b) { return b != 0; })) return 0;
  if (out.size() < kSentBoundBytes + body) return 0;
  std::copy_n(bounds + 4, kSentBoundBytes, out.begin());
  std::copy_n(bytes + head.size(), body, out.begin() + kSentBoundBytes);
  return kSentBoundBytes + body;
}

bool decodeCloud(std::span<const std::uint8_t> bytes, int components, std::span<std::int16_t> values) {
  const std::size_t points = values.size() / static_cast<std::size_t>(components);
  const Prefix head = prefix(points, components);
  std::vector<char> stream(head.begin(), head.end());
  stream.insert(stream.end(), bytes.begin() + kSentBoundBytes, bytes.end());
  stream.insert(stream.end(), 4, 0);
  stream.insert(stream.end(), {static_cast<char>(bytes[0]), static_cast<char>(bytes[1]), 0, 0});
  draco::DecoderBuffer buffer;
  buffer.Init(stream.data(), stream.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodePointCloudFromBuffer(&buffer);
  if (!decoded.ok() || buffer.remaining_size() != 0) return false;
  const draco::PointCloud& cloud = *decoded.value();
  if (cloud.num_attributes() != 1 || cloud.num_points() != points) return false;
  const draco::PointAttribute& attribute = *cloud.attribute(0);
  if (attribute.size() != points || attribute.num_components() != components ||
      attribute.data_type() != draco::DT_INT16)
    return false;
  for (std::size_t k = 0; k < points; ++k)
    attribute.GetValue(draco::AttributeValueIndex(static_cast<std::uint32_t>(k)),
                       values.data() + k * static_cast<std::size_t>(components));
  return std::all_of(values.begin(), values.end(), [](std::int16_t v) { return v >= 0; });
}

bool countsValid(std::size_t values, int components) {
  return components >= 1 && components <= kMaxDracoComponents && values > 0 &&
         values % static_cast<std::size_t>(components) == 0 &&
         values / static_cast<std::size_t>(components) <= kMaxDracoPoints;
}

}  // namespace

std::size_t encodeValues(std::span<const std::int16_t> values, int components, std::span<std::uint8_t> out) {
  if (!countsValid(values.size(), components) || *std::min_element(values.begin(), values.end()) != 0)
    return 0;
  try {
    return encodeCloud(values, components, out);
  } catch (const std::exception&) {  // out of memory
    return 0;
  }
}

bool decodeValues(std::span<const std::uint8_t> bytes, int components, std::span<std::int16_t> values) {
  if (!countsValid(values.size(), components) || bytes.size() < kSentBoundBytes) return false;
  try {
    return decodeCloud(bytes, components, values);
  } catch (const std::exception&) {  // out of memory, or a length that Draco did not check
    return false;
  }
}

}  // namespace fathom::telemetry
