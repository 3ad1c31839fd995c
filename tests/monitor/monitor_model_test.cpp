#include "telemetry/monitor/model/monitor_model.hpp"
#include "realtime/base/units.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "telemetry/monitor/export/exports.hpp"
#include "telemetry/monitor/map/received_map.hpp"
#include "telemetry/monitor/web/page_api.hpp"
#include "tests/monitor/sample_dive.hpp"
#include "tests/telemetry/sample_tile.hpp"

namespace fathom::monitor {
namespace {

using Frame = std::vector<std::uint8_t>;

// Everything that is shown of a model, as one string.
std::string shown(const MonitorModel& model) {
  ModelView view;
  view.take(model);
  return trackJson(view) + trackGeoJson(view) + mapBinary(view.store(), view.surface(), 0, 0).substr(8);
}

TEST(MonitorModel, RebuildsTheMapAsItWasOnBoardFromALosslessLink) {
  SampleDive dive{.duration_s = 400, .rate_bps = 3000, .loss = 0};
  MonitorModel model;
  for (const auto& [utc_ns, bytes] : dive.packets()) model.accept(bytes, utc_ns);
  const Surface surface(model.map().store());
  int compared = 0;
  for (double north = 5; north < 35; north += 0.25) {
    for (double east = 2; east < 8; east += 0.25) {
      if (north >= 7 && north < 21) continue;  // sent again, deeper
      const auto point = surface.sample(north, east);
      ASSERT_TRUE(point) << north << ' ' << east;
      ASSERT_NEAR(point->depth, SampleDive::depthAt(north, east), 0.0501) << north << ' ' << east;
      EXPECT_TRUE(point->has_colour);
      ++compared;
    }
  }
  EXPECT_GT(compared, 1000);
  EXPECT_GT(model.map().store().counters().changed, 10U);
  EXPECT_NEAR(surface.sample(12.5, 3.5)->depth, SampleDive::depthAt(12.5, 3.5) + 0.3, 0.0501);
  EXPECT_EQ(model.mission()->vehicle_name, "sirius");
  EXPECT_EQ(model.receiver().counters().lost, 0U);
  EXPECT_EQ(model.receiver().counters()[telemetry::FrameVerdict::kBadPayload], 0U);
}

TEST(MonitorModel, DuplicateReorderedGarbageAndForeignFramesChangeNothingThatIsShown) {
  SampleDive dive, other;
  dive.duration_s = other.duration_s = 300;
  other.identity.dive_id = 43;
  const auto frames = dive.packets();
  const auto foreign = other.packets();
  MonitorModel clean(dive.identity), dirty(dive.identity);
  for (const auto& [utc_ns, bytes] : frames) clean.accept(bytes, 0);

  std::mt19937 random(5);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const auto& [utc_ns, bytes] = frames[i];
    Frame garbage(random() % 300);
    for (auto& byte : garbage) byte = static_cast<std::uint8_t>(random());
    dirty.accept(garbage, 0);
    if (i < foreign.size()) dirty.accept(foreign[i].bytes, 0);
    Frame damaged = bytes;
    damaged[random() % damaged.size()] ^= static_cast<std::uint8_t>(1U << random() % 8);
    dirty.accept(damaged, 0);
    dirty.accept(bytes, 0);
    dirty.accept(bytes, 0);
  }
  EXPECT_EQ(shown(dirty), shown(clean));
  const auto& c = dirty.receiver().counters();
  EXPECT_EQ(c[telemetry::FrameVerdict::kAccepted], frames.size());
  EXPECT_EQ(c[telemetry::FrameVerdict::kDuplicate], frames.size());
  EXPECT_EQ(c[telemetry::FrameVerdict::kForeign], std::min(frames.size(), foreign.size()));
}

Frame frameOf(telemetry::MessageType type, std::uint16_t sequence, std::span<const std::uint8_t> payload) {
  Frame frame(telemetry::kMaxFrameBytes);
  frame.resize(telemetry::encodeFrame({{7, 42}, sequence, type, false}, payload, frame));
  return frame;
}

TEST(MonitorModel, LateStatusDoesNotTakeTheVehicleBack) {
  SampleDive dive;
  MonitorModel model;
  for (const auto& [t, sequence] : {std::pair{100.0, 2}, std::pair{50.0, 1}}) {
    Frame payload(64);
    payload.resize(telemetry::encodeStatus(dive.statusAt(t), payload));
    model.accept(frameOf(telemetry::MessageType::kStatus, static_cast<std::uint16_t>(sequence), payload),
                 dive.statusAt(110).utc_ns);
  }
  EXPECT_EQ(model.status()->utc_ns, dive.statusAt(100).utc_ns);
  EXPECT_EQ(model.track().size(), 2U);
}

TEST(MonitorModel, AnInvalidMessageInAWholeFrameIsCountedAndChangesNothing) {
  MonitorModel model;
  const Frame payload(11, 0xFF);
  for (std::uint8_t type : {1, 2, 3, 4, 6})
    EXPECT_EQ(model.accept(frameOf(static_cast<telemetry::MessageType>(type), type, payload), 0).verdict,
              telemetry::FrameVerdict::kBadPayload)
        << unsigned{type};
  EXPECT_FALSE(model.status() || model.mission());
  EXPECT_TRUE(model.track().empty() && model.map().store().size() == 0);
}

telemetry::DecodedTile decodedTile(const HeightTile& tile, int stride) {
  telemetry::DecodedTile out{tile, stride, 0.02, 3};
  for (int i = 0; i < HeightTile::kSide; ++i)
    for (int j = 0; j < HeightTile::kSide; ++j)
      if (i % stride != 0 || j % stride != 0) out.tile.at(i, j).coverage = 0;
  return out;
}

TEST(ReceivedMap, TilesOfTheOtherCodecBecomeBlocksAndOldRevisionsAreLeft) {
  ReceivedMap map;
  const HeightTile first = telemetry::sampleTile(-1, 3, 4, 1, 1, 5),
                   second = telemetry::sampleTile(-1, 3, 4, 1, 2, 6);
  map.takeTile(decodedTile(second, 1), 1, 1);
  EXPECT_EQ(map.store().size(5), 16U);  // 4 m at 25 cm
  map.takeTile(decodedTile(first, 1), 2, 2);
  EXPECT_NEAR(Surface(map.store()).sample(-4 + 1.25, 12 + 2.5)->depth, second.at(5, 10).depth, 0.0101);
  map.takeTile(decodedTile(second, 8), 3, 3);  // 2 x 2 nodes of a block of 2 m spacing
  EXPECT_EQ(map.store().size(8), 1U);
  EXPECT_EQ(map.store().find({8, -1, 1})->block.seen, 0b1100'1100'0000'0000);
}

TEST(Coverage, WhatTheVehiclePassedAndNobodyReceivedIsPending) {
  Track track;
  for (int t = 0; t <= 40; ++t)
    track[std::int64_t{t} * 1'000'000'000] = {t * 0.5, 0.5, 18, telemetry::kAbsent};
  track.begin()->second.altitude = 3;  // tan(21 deg) of 3 m: 1.15 m to either side
  BlockStore store;
  const Coverage none = coverageOf(track, store, 0);
  EXPECT_NEAR(static_cast<double>(none.pending.size()), 20 * 3, 6);  // three columns of squares
  EXPECT_NEAR(none.pending.front().depth, 21, 1e-5);
  SampleDive dive;
  for (int n = -2; n < 10; ++n)
    for (int e = -3; e < 3; ++e) store.put(dive.blockOf({5, n, e}), {0, 0.05, true, 0});
  const Coverage half = coverageOf(track, store, 0);
  EXPECT_EQ(half.received_area, 12 * 6);
  for (const auto& square : half.pending) EXPECT_GE(square.north, 10);
  EXPECT_LT(half.pending.size(), none.pending.size() * 2 / 3);
  EXPECT_EQ(half.changed_area, 0);
  store.put(dive.blockOf({5, 0, 0}, 1), {5, 0.05, true, 5});
  EXPECT_EQ(coverageOf(track, store, 6).changed_area, 1);
  EXPECT_EQ(coverageOf(track, store, 3600'000'000'000).changed_area, 0);
}

TEST(MonitorModel, AStatusOrTrackPointOfAnotherYearIsNotShownUnlessTheClockIsThatFarOff) {
  constexpr std::int64_t kYear_ns = 365LL * 86'400 * 1'000'000'000;
  MonitorModel model;
  std::array<std::uint8_t, telemetry::kMaxFrameBytes> payload, frame;
  telemetry::Version version = 1;
  std::int64_t now_ns = 1'790'000'000'000'000'000;
  const auto receive = [&](telemetry::MessageType type, std::size_t size) {
    now_ns += 10'000'000'000;
    (void)model.accept(std::span(frame).first(telemetry::encodeFrame({{7, 42}, version++, type, false},
                                                                     std::span(payload).first(size), frame)),
                       now_ns);
  };
  const auto status = [&](std::int64_t off_ns) {
    telemetry::Status s{.utc_ns = now_ns + off_ns};
    receive(telemetry::MessageType::kStatus, telemetry::encodeStatus(s, payload));
    return model.status() ? now_ns - model.status()->utc_ns : -1;
  };
  const auto near = [](std::int64_t apart_ns, std::int64_t off_ns) {
    return std::abs(apart_ns + off_ns) < 15'000'000'000;
  };
  EXPECT_TRUE(near(status(0), 0));
  const std::size_t track = model.track().size();
  EXPECT_TRUE(near(status(kYear_ns), -10'000'000'000)) << "the one before stands";
  EXPECT_EQ(model.track().size(), track);
  EXPECT_TRUE(near(status(0), 0));
  const std::array<telemetry::TrackPoint, 1> far{{{now_ns + kYear_ns, 1, 2, 3}}};
  receive(telemetry::MessageType::kTrack, telemetry::encodeTrack(far, payload));
  EXPECT_LT(model.track().rbegin()->first, now_ns + kYear_ns / 2);
  (void)status(kYear_ns);  // the vehicle's clock has jumped
  EXPECT_TRUE(near(status(kYear_ns), kYear_ns));
}

TEST(RequestLedger, ARequestIsDoneWhenAReportSaysSoOfTheFrameThatSaidIt) {
  std::array<std::uint8_t, telemetry::LinkKey::kBytes> secret{};
  telemetry::DownlinkSender sender({7, 42}, telemetry::LinkKey(secret));
  telemetry::Request request{.kind = telemetry::Request::Kind::kPauseMap};
  RequestLedger ledger;
  const auto id = sender.request(request);
  ASSERT_TRUE(id);
  request.id = *id;
  ledger.add(request, 5);
  std::array<std::uint8_t, telemetry::kMaxFrameBytes> frame;
  std::int64_t now = 1'790'000'000'000'000'000;
  int confirmed = 0;
  using State = telemetry::RequestOutcome::State;
  const auto receive = [&](std::uint8_t of, telemetry::DownlinkCounter counter, State state) {
    telemetry::StateReport report;
    report.requests[1] = {state, of, counter & ((1U << telemetry::kOutcomeCounterBits) - 1)};
    ledger.noteReport(report, now, [&](std::uint8_t) { ++confirmed; });
    return ledger.entries().front().state;
  };
  const auto counter = telemetry::downlinkCounterAt(now);
  EXPECT_EQ(receive(*id, counter, State::kDone), RequestLedger::State::kQueued) << "not even sent";
  ledger.noteSent(std::span<const std::uint8_t>(frame).first(sender.nextFrame(now, frame)), now);
  EXPECT_EQ(ledger.entries().front().state, RequestLedger::State::kSent);
  EXPECT_EQ(receive(*id, counter + 1, State::kDone), RequestLedger::State::kSent) << "of another of this id";
  EXPECT_EQ(receive(static_cast<std::uint8_t>(*id + 1), counter, State::kDone), RequestLedger::State::kSent);
  EXPECT_EQ(confirmed, 0);
  EXPECT_EQ(receive(*id, counter, State::kTaken), RequestLedger::State::kTaken);
  EXPECT_EQ(receive(*id, counter, State::kDone), RequestLedger::State::kDone);
  EXPECT_EQ(confirmed, 2);
  for (int n = 0; n < 40; ++n) ledger.add(request, 7);
  EXPECT_EQ(ledger.entries().size(), RequestLedger::kMaxEntries);
}

TEST(RequestLedger, WhatWasSaidAsOftenAsItIsAndThatNoReportNamesHasNoAnswer) {
  telemetry::Request request;
  RequestLedger ledger;
  ledger.add(request, 5);
  ledger.noteGivenUp(6, [](std::uint8_t) { return true; });
  EXPECT_EQ(ledger.entries().front().state, RequestLedger::State::kQueued);
  ledger.noteGivenUp(7, [](std::uint8_t) { return false; });
  EXPECT_EQ(ledger.entries().front().state, RequestLedger::State::kUnanswered);
}

TEST(LinkHistory, AClockThatBeganInAnotherDecadeDoesNotStretchIt) {
  LinkHistory history;
  constexpr std::int64_t kNow_ns = 1'790'000'000 * kSecond_ns;
  for (int k = 0; k < 100; ++k) history.add(k * 20 * kSecond_ns, 100, true, 0);
  for (int k = 0; k < 100; ++k) history.add(kNow_ns + k * 20 * kSecond_ns, 100, true, 0);
  EXPECT_EQ(history.step(), LinkHistory::kFirstStep_ns);
  EXPECT_GE(history.start(), kNow_ns - LinkHistory::kFirstStep_ns);
  EXPECT_NEAR(history.recent(60, kNow_ns + 1980 * kSecond_ns).rate_bps, 40, 15);
}

TEST(LinkHistory, StaysBoundedAndKeepsItsSums) {
  LinkHistory history;
  for (int t = 0; t < 200'000; ++t)
    history.add(1'000'000'000LL * t, 10, t % 5 != 0, static_cast<std::uint64_t>(t / 5));
  EXPECT_LE(history.steps().size(), LinkHistory::kMaxSteps);
  std::uint64_t accepted = 0, bytes = 0;
  std::int64_t lost = 0;
  for (const auto& step : history.steps()) {
    accepted += step.accepted;
    bytes += step.bytes;
    lost += step.lost;
  }
  EXPECT_EQ(accepted, 160'000U);
  EXPECT_EQ(bytes, 1'600'000U);
  EXPECT_EQ(lost, 39'999);
  const auto recent = history.recent(3600, 200'000'000'000'000);
  EXPECT_NEAR(recent.loss, 0.2, 0.01);
  EXPECT_NEAR(recent.rate_bps, 64, 8);
}

TEST(Reports, StateIsJsonBeforeAnythingArrivedAndTheMapComesOnlyOnce) {
  SharedModel shared(std::nullopt, std::nullopt, 1);
  ModelView view;
  const auto empty = nlohmann::json::parse(stateJson(shared, view));
  EXPECT_TRUE(empty["status"].is_null() && empty["identity"].is_null() && empty["link"]["age_s"].is_null());
  EXPECT_FALSE(empty["downlink"]["enabled"].get<bool>());
  SampleDive dive{.duration_s = 300};
  for (const auto& [utc_ns, bytes] : dive.packets()) shared.model->accept(bytes, utc_ns);
  const auto state = nlohmann::json::parse(stateJson(shared, view));
  EXPECT_GT(mapBinary(view.store(), view.surface(), 0, 0).size(), 1000U);
  EXPECT_EQ(mapBinary(view.store(), view.surface(), view.store().version(), 0).size(), 24U);
  EXPECT_GT(state["map"]["area_m2"].get<double>(), 50);
  const auto profile = nlohmann::json::parse(profileJson(view.surface(), 0, 3, 20, 3));
  EXPECT_EQ(profile["points"].size(), static_cast<std::size_t>(kProfilePoints) + 1);
}

TEST(Reports, WhatMovedGetsOldOnASilentLinkToo) {
  SharedModel shared(std::nullopt, std::nullopt, 1);
  ModelView view;
  std::int64_t last = 0;
  for (const auto& [utc_ns, bytes] : SampleDive().packets()) shared.model->accept(bytes, last = utc_ns);
  const auto movedAfter = [&](double seconds) {
    shared.now_utc_ns = last + static_cast<std::int64_t>(seconds * 1e9);
    return nlohmann::json::parse(stateJson(shared, view))["map"]["changed_m2"].get<double>();
  };
  EXPECT_GT(movedAfter(1), 0);
  EXPECT_EQ(movedAfter(kRecent_s + 1), 0);
}

TEST(Reports, ALargeMapComesInPiecesThatLoseNothing) {
  BlockStore store;
  Surface surface(store);
  SampleDive dive;
  for (int n = 0; n < 64; ++n)
    for (int e = 0; e < 64; ++e) store.put(dive.blockOf({5, n, e}), {0, 0.05, true, 0});
  std::uint32_t version = 0, chunks = 0;
  for (int pieces = 0; version != store.version(); ++pieces) {
    ASSERT_LT(pieces, 20);
    const std::string piece = mapBinary(store, surface, version, 0);
    EXPECT_LT(piece.size(), 2U * kMaxStreamBytes);
    std::uint32_t next = 0, count = 0;
    std::memcpy(&next, piece.data() + 4, 4);
    std::memcpy(&count, piece.data() + 8, 4);
    ASSERT_GT(next, version);
    version = next;
    chunks += count;
  }
  EXPECT_EQ(chunks, store.chunks().size());
}

}  // namespace
}  // namespace fathom::monitor
