#include "realtime/onboard/live/live_config.hpp"

#include "firmware_if/devices/device_address.hpp"
#include "realtime/base/units.hpp"

namespace fathom::onboard {
namespace {

void visitOverload(KeyVisitor& keys, rt::OverloadConfig& c) {
  keys.number("raise_at", c.raise_at, "of the pairs' period", 0.1, 10, "a pair that took longer is slow");
  keys.number("lower_at", c.lower_at, "of the pairs' period", 0.01, c.raise_at,
              "one that took less, with none waiting, is easy");
  keys.integer("raise_after", c.raise_after, "pairs", 1, 100, "so many slow ones in a row: one level up");
  keys.integer("lower_after", c.lower_after, "pairs", 1, 1000, "so many easy ones: one level down");
  keys.integer("waiting_limit", c.waiting_limit, "pairs", 1, 100, "so many waiting count as slow");
  keys.integer("drop_waiting", c.drop_waiting, "pairs", c.waiting_limit, 100, "so many: level 4 at once");
}

}  // namespace

void visitLive(KeyVisitor& keys, LiveConfig& c, const io::MissionConfig& mission) {
  keys.table("cameras", "GigE Vision; must be named for a live dive",
             [&] { io::visitCameras(keys, c.cameras, mission); });
  keys.table("dvl", "Doppler velocity log", [&] { io::visitDvl(keys, c.dvl); });
  keys.table("can", "NMEA 2000", [&] { io::visitCan(keys, c.can); });
  c.can.samples.latitude = mission.origin.latitude;
  keys.table("lcm", "messages of other programs, and ours", [&] { io::visitLcm(keys, c.lcm); });
  keys.table("modem", "of the acoustic link", [&] { io::visitModem(keys, c.modem); });
  keys.table("predive", "limits of fathom-sensors predive", [&] { io::visitPredive(keys, c.predive); });
  keys.table("recorder", "", [&] { io::visitRecorder(keys, c.recorder); });
  keys.table("realtime", "threads of the tiers", [&] { rt::visitRealtime(keys, c.realtime); });
  keys.table("memory", "", [&] { rt::visitMemory(keys, c.memory); });
  keys.table("overload", "when work is shed", [&] { visitOverload(keys, c.overload); });
  keys.table("restart", "saved states", [&] {
    keys.number("checkpoint_s", c.checkpoint_s, "s", 1, 600, "between two saved states");
    keys.scaled("buffer_mib", c.checkpoint_bytes, static_cast<std::int64_t>(kMebibyte), "MiB", 1, 4096,
                "that one may take, and what it is read into; larger ones are not saved, and counted "
                "(checkpoints.too_large of live.json)");
  });
}

}  // namespace fathom::onboard
