#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>

#include "realtime/base/files/atomic_file.hpp"
#include "recon/geometry/geodesy.hpp"
#include "recon/geometry/sensor_samples.hpp"

namespace fathom::io {

// ACFR text navigation: one observation a line, "TYPE: <seconds UTC> <key>:<value> ...", with or without
// spaces behind the colons; -9999 marks an absent value. Lines PAROSCI (depth), RDI (DVL; its velocities are
// in the DVL frame), PHINS_COMPASS (attitude, true heading), SSBL_FIX (USBL; target_x and target_y are north
// and east of the mission's origin) and VIS (an image) become samples in the file's order. In a file without
// PHINS_COMPASS lines the RDI lines give the attitude too. A fix has no accuracy here: 0.2 m and 0.25 degrees
// of slant range are assumed, as of Sirius' USBL (Williams et al., "Monitoring of Benthic Reference Sites",
// 2012, and later ACFR tables).
class RawAuvReader {
 public:
  // Throws InputError for an absent, unreadable or empty file.
  RawAuvReader(const std::filesystem::path& path, const Geodetic& origin);

  [[nodiscard]] std::optional<SensorSample> next();
  void rewind();
  [[nodiscard]] std::uint64_t skippedLines() const { return skipped_; }  // of types that are not read
  // Malformed lines of types that are read.
  [[nodiscard]] std::uint64_t damagedLines() const { return damaged_; }

 private:
  bool readLine(std::string& line);
  [[nodiscard]] bool parseLine(const std::string& line);

  std::ifstream in_;
  LocalTransverseMercator projection_;
  bool has_compass_lines_ = false;
  std::deque<SensorSample> pending_;
  std::uint64_t skipped_ = 0, damaged_ = 0;
};

// Writes such a file; samples without a line of their own (GPS, water, battery) are left out. Appears whole
// with commit().
class RawAuvWriter {
 public:
  // `magnetic_declination` [rad] turns magnetic headings into the true ones of PHINS_COMPASS and h_true.
  RawAuvWriter(const std::filesystem::path& path, const Geodetic& origin, double magnetic_declination);
  void write(const SensorSample& sample);
  void commit() { file_.commit(); }

 private:
  void writeDvl(const DvlSample& dvl);
  void writeAttitude(const AttitudeSample& attitude);
  void writeUsbl(const UsblFix& fix);

  AtomicFile file_;
  LocalTransverseMercator projection_;
  double magnetic_declination_;             // [rad]
  std::optional<AttitudeSample> attitude_;  // the latest, for the RDI line
};

}  // namespace fathom::io
