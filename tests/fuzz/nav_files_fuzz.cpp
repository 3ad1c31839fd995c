#include <cmath>

#include "recon/import/navigation/nav_data.hpp"
#include "tests/fuzz/scratch_file.hpp"

using namespace fathom;

// Any bytes as a table of navigation or a log of NMEA 0183, behind good beginnings too; the first byte says
// which.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::ScratchFile scratch("nav");
  static const std::vector<std::string> kColumns{"", "time=t:ms,depth=z", "time=t:%Y-%m-%d %H:%M:%S",
                                                 "date=d"};
  static const std::vector<std::string> kBeginnings{
      "",
      "time,lat,lon,depth,heading,pitch,roll,altitude,vx,vy,vz\n",
      "t,z\n1708171200500,3.25\n",
      "date,time,easting,northing\n",
      "$GPRMC,120000.00,A,4248.1000,N,01047.2000,E,0.5,12.0,170224,,,A*",
      "$GPZDA,120000.00,17,02,2024,00,00*6D\n$HEHDT,"};
  if (size == 0) return 0;
  topside::NavFileOptions options{.columns = kColumns[data[0] % kColumns.size()]};
  std::string text = kBeginnings[data[0] / kColumns.size() % kBeginnings.size()];
  text.append(reinterpret_cast<const char*>(data) + 1, size - 1);
  scratch.write(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
  options.files = {scratch.path()};
  fuzz::readsOrRefuses([&] {
    const topside::NavData nav = topside::readNavFiles(options, 1'708'171'200'000'000'000);
    const Geodetic origin = topside::originOf(nav).value_or(Geodetic());
    for (const auto& row : nav.position)
      if (!row.value.allFinite() || std::abs(row.value.x()) > 1.571 || !(row.value.z() > 0)) __builtin_trap();
    if (!nav.empty())
      (void)topside::knownAt(nav, origin, {1'708'171'200'000'000'000, 1'708'171'201'000'000'000});
  });
  return 0;
}
