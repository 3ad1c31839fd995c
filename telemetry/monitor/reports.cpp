#include "telemetry/monitor/reports.hpp"

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <numbers>

namespace fathom::monitor {

using nlohmann::ordered_json;
using telemetry::FrameVerdict;
using telemetry::MessageType;

namespace {

constexpr double kDegree = std::numbers::pi / 180;

double seconds(std::int64_t ns) {
  return static_cast<double>(ns) * 1e-9;
}

ordered_json orNull(double value) {
  return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr);
}

ordered_json statusJson(const telemetry::Status& s) {
  ordered_json health = ordered_json::array();
  for (unsigned bit = 0; bit < telemetry::kHealthBits; ++bit)
    if ((s.health >> bit & 1U) != 0) health.push_back(telemetry::healthText(bit));
  return {{"utc_s", seconds(s.utc_ns)},
          {"north_m", s.north},
          {"east_m", s.east},
          {"depth_m", s.depth},
          {"roll_deg", s.roll / kDegree},
          {"pitch_deg", s.pitch / kDegree},
          {"heading_deg", s.heading / kDegree},
          {"altitude_m", orNull(s.altitude)},
          {"speed_mps", s.speed},
          {"position_sigma_m", orNull(s.position_sigma)},
          {"battery", orNull(s.battery)},
          {"pairs_seen", s.pairs_seen},
          {"pairs_dropped", s.pairs_dropped},
          {"map_area_m2", s.map_area},
          {"mission_progress", orNull(s.mission_progress)},
          {"health", health},
          {"slipped_cycles", s.slipped_cycles},
          {"shed_work", s.shed_work},
          {"pool_refusals", s.pool_refusals}};
}

ordered_json linkJson(const MonitorModel& model, const FeedState& feed) {
  const auto& c = model.receiver().counters();
  const auto& tiles = model.reassembler().counters();
  ordered_json rejected, types;
  for (std::size_t v = 1; v < telemetry::kFrameVerdicts; ++v)
    rejected[telemetry::name(static_cast<FrameVerdict>(v))] = c.verdicts[v];
  for (const auto type : {MessageType::kStatus, MessageType::kTrack, MessageType::kMissionInfo,
                          MessageType::kMapPacket, MessageType::kRepair, MessageType::kTileFragment})
    types[telemetry::name(type)] = model.accepted(type);
  const auto last = model.lastAcceptedUtcNs();
  return {
      {"frames", c.frames},
      {"bytes", c.bytes},
      {"accepted", c[FrameVerdict::kAccepted]},
      {"lost", c.lost},
      {"repaired", c.repaired},
      {"reordered", c.reordered},
      {"rejected", rejected},
      {"types", types},
      {"rate_bps", model.recentRateBps(feed.now_utc_ns)},
      {"last_utc_s", last ? ordered_json(seconds(*last)) : ordered_json(nullptr)},
      {"age_s", last ? ordered_json(std::max(0.0, seconds(feed.now_utc_ns - *last))) : ordered_json(nullptr)},
      {"tiles_open", model.reassembler().open()},
      {"tiles_evicted", tiles.evicted},
      {"tiles_undecodable", tiles.undecodable + tiles.conflicting}};
}

template <class T>
void append(std::string& out, T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));  // the machines this runs on are little-endian, as is the format
  out.append(bytes, sizeof(T));
}

}  // namespace

std::string stateJson(const MonitorModel& model, const FeedState& feed) {
  ordered_json json{{"version", model.version()},
                    {"map_version", model.map().version()},
                    {"track_points", model.track().size()},
                    {"recorded", feed.recorded},
                    {"finished", feed.finished},
                    {"now_utc_s", seconds(feed.now_utc_ns)}};
  json["identity"] = nullptr;
  if (const auto& id = model.receiver().identity())
    json["identity"] = {{"vehicle_id", id->vehicle_id}, {"dive_id", id->dive_id}};
  json["mission"] = nullptr;
  if (const auto& m = model.mission())
    json["mission"] = {{"vehicle_name", m->vehicle_name},
                       {"origin_latitude_deg", m->origin.latitude / kDegree},
                       {"origin_longitude_deg", m->origin.longitude / kDegree},
                       {"start_utc_s", seconds(m->start_utc_ns)},
                       {"schema_differs", model.schemaDiffers()}};
  json["status"] = model.status() ? statusJson(*model.status()) : ordered_json(nullptr);
  json["link"] = linkJson(model, feed);
  json["map"] = {
      {"tiles", model.map().size()}, {"area_m2", model.map().area()}, {"refused", model.map().refused()}};
  return json.dump();
}

std::string trackJson(const MonitorModel& model) {
  ordered_json points = ordered_json::array();
  for (const auto& [utc_ns, p] : model.track()) points.push_back({seconds(utc_ns), p.north, p.east, p.depth});
  return ordered_json{{"points", points}}.dump();
}

std::string tilesBinary(const MonitorModel& model, std::uint64_t since) {
  std::string out = "FTIL";
  std::uint32_t count = 0;
  append(out, static_cast<std::uint32_t>(model.map().version()));
  append(out, count);
  constexpr std::size_t kCountAt = 8;
  for (const auto& [key, received] : model.map().tiles()) {
    if (received.version <= since) continue;
    ++count;
    const HeightTile tile = model.map().shown(received);
    const int stride = received.content.stride;
    float sigma = 0;
    for (const auto& node : received.content.tile.nodes) sigma = std::max(sigma, node.sigma);
    append(out, tile.north_index);
    append(out, tile.east_index);
    append(out, tile.level);
    append(out, static_cast<std::uint8_t>(stride));
    append(out, static_cast<std::uint8_t>(received.content.colour_bits));
    append(out, static_cast<float>(tile.size));
    append(out, tile.revision);
    append(out, sigma);
    append(out, seconds(received.received_utc_ns));
    std::string colours;
    for (int i = 0; i < HeightTile::kSide; i += stride) {
      for (int j = 0; j < HeightTile::kSide; j += stride) {
        const HeightTile::Node& node = tile.at(i, j);
        append(out, node.coverage > 0 ? node.depth : std::numeric_limits<float>::quiet_NaN());
        for (const std::uint8_t channel : node.colour) append(colours, channel);
      }
    }
    colours.resize((colours.size() + 3) / 4 * 4);
    out += colours;
  }
  std::memcpy(out.data() + kCountAt, &count, sizeof count);
  return out;
}

std::string trackGeoJson(const MonitorModel& model) {
  if (!model.mission() || model.track().empty()) return {};
  const LocalTransverseMercator projection(model.mission()->origin);
  const auto position = [&](double north, double east, double depth) {
    const Geodetic g = projection.toGeodetic({north, east});
    return ordered_json{g.longitude / kDegree, g.latitude / kDegree, -depth};
  };
  ordered_json line = ordered_json::array(), times = ordered_json::array();
  for (const auto& [utc_ns, p] : model.track()) {
    line.push_back(position(p.north, p.east, p.depth));
    times.push_back(seconds(utc_ns));
  }
  ordered_json features = ordered_json::array();
  const auto& last = model.track().rbegin()->second;
  const auto identity = model.receiver().identity().value_or(telemetry::LinkIdentity{});
  // GeoJSON wants at least two positions in a line.
  if (line.size() > 1)
    features.push_back({{"type", "Feature"},
                        {"properties", {{"name", "track"}, {"utc_s", times}}},
                        {"geometry", {{"type", "LineString"}, {"coordinates", line}}}});
  features.push_back(
      {{"type", "Feature"},
       {"properties",
        {{"name", model.mission()->vehicle_name},
         {"vehicle_id", identity.vehicle_id},
         {"dive_id", identity.dive_id},
         {"utc_s", times.back()}}},
       {"geometry", {{"type", "Point"}, {"coordinates", position(last.north, last.east, last.depth)}}}});
  return ordered_json{{"type", "FeatureCollection"}, {"features", features}}.dump(1) + "\n";
}

}  // namespace fathom::monitor
