#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "realtime/base/civil_time.hpp"

namespace fathom::test {

// Builds PD0 ensembles byte by byte, independently of the decoder, so that tests can say what is on the wire.
class Pd0Builder {
 public:
  std::uint32_t number = 1;
  std::uint8_t transform = 0x17;                // ship, tilts used
  std::uint16_t system_configuration = 0x0200;  // 30 degree beams, down-looking
  std::array<std::uint8_t, 7> clock = {14, 12, 19, 17, 17, 55, 94};
  std::array<std::uint8_t, 8> clock_with_century{};  // all zero: not sent
  std::uint16_t sound_speed = 1500;
  std::uint16_t heading = 0;  // hundredths of a degree
  std::int16_t pitch = 0, roll = 0;
  bool bottom_track = true;
  std::array<std::int16_t, 4> velocity = {-100, -1500, 20, 3};  // mm/s
  std::array<std::uint32_t, 4> range = {200, 210, 220, 230};    // cm
  std::size_t profile_cells = 3;

  void setClock(std::int64_t utc_ns) {
    const io::CivilTime t = io::civilFromUtc(utc_ns);
    std::size_t i = 0;
    for (const int value :
         {t.year % 100, t.month, t.day, t.hour, t.minute, t.second, t.nanosecond / 10'000'000})
      clock[i++] = static_cast<std::uint8_t>(value);
  }
  [[nodiscard]] std::vector<std::uint8_t> bytes() const {
    std::vector<std::vector<std::uint8_t>> blocks = {fixedLeader(), variableLeader(), velocityProfile()};
    if (bottom_track) blocks.push_back(bottomTrack());
    return assemble(blocks);
  }

  // Header, offset table, blocks, checksum.
  static std::vector<std::uint8_t> assemble(const std::vector<std::vector<std::uint8_t>>& blocks) {
    std::vector<std::uint8_t> out(6 + 2 * blocks.size());
    out[0] = out[1] = 0x7F;
    out[5] = static_cast<std::uint8_t>(blocks.size());
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      put16(out, 6 + 2 * i, static_cast<std::uint16_t>(out.size()));
      out.insert(out.end(), blocks[i].begin(), blocks[i].end());
    }
    put16(out, 2, static_cast<std::uint16_t>(out.size()));
    std::uint32_t sum = 0;
    for (const std::uint8_t byte : out) sum += byte;
    out.resize(out.size() + 2);
    put16(out, out.size() - 2, static_cast<std::uint16_t>(sum));
    return out;
  }

  [[nodiscard]] std::vector<std::uint8_t> fixedLeader() const {
    std::vector<std::uint8_t> block(59);
    put16(block, 4, system_configuration);
    block[8] = 4;
    block[9] = static_cast<std::uint8_t>(profile_cells);
    block[25] = transform;
    block[58] = 30;
    return block;
  }

  [[nodiscard]] std::vector<std::uint8_t> variableLeader() const {
    std::vector<std::uint8_t> block(65);
    put16(block, 0, 0x0080);
    put16(block, 2, static_cast<std::uint16_t>(number));
    for (std::size_t i = 0; i < clock.size(); ++i) block[4 + i] = clock[i];
    block[11] = static_cast<std::uint8_t>(number >> 16);
    put16(block, 14, sound_speed);
    put16(block, 18, heading);
    put16(block, 20, static_cast<std::uint16_t>(pitch));
    put16(block, 22, static_cast<std::uint16_t>(roll));
    for (std::size_t i = 0; i < clock_with_century.size(); ++i) block[57 + i] = clock_with_century[i];
    return block;
  }

  [[nodiscard]] std::vector<std::uint8_t> velocityProfile() const {
    std::vector<std::uint8_t> block(2 + 8 * profile_cells, 0x11);
    put16(block, 0, 0x0100);
    return block;
  }

  [[nodiscard]] std::vector<std::uint8_t> bottomTrack() const {
    std::vector<std::uint8_t> block(81);
    put16(block, 0, 0x0600);
    for (std::size_t beam = 0; beam < 4; ++beam) {
      put16(block, 16 + 2 * beam, static_cast<std::uint16_t>(range[beam]));
      put16(block, 24 + 2 * beam, static_cast<std::uint16_t>(velocity[beam]));
      block[77 + beam] = static_cast<std::uint8_t>(range[beam] >> 16);
    }
    return block;
  }

 private:
  static void put16(std::vector<std::uint8_t>& out, std::size_t at, std::uint16_t value) {
    out[at] = static_cast<std::uint8_t>(value);
    out[at + 1] = static_cast<std::uint8_t>(value >> 8);
  }
};

}  // namespace fathom::test
