
#include "recon/import/control_points.hpp"
#include "tests/fuzz/scratch_file.hpp"

using namespace fathom;

// Any bytes as the tables of a control folder: two rows' ends divide them, good beginnings stand before each.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::ScratchFile scratch("marks.csv");
  static const std::array<std::array<const char*, 3>, 3> kBeginnings = {
      {{"name,north,east,depth,sigma_m,use\nA,1,2,12,0.01,control\n",
        "point,image,u,v,sigma_px\nA,1.png,10,20,1\n", "from,to,length_m,sigma_m\n"},
       {"name,latitude,longitude,height\n", "point,image,u,v\nA,left/1.png,1,2\nB,2.png,3,4\n",
        "from,to,length_m\nA,B,1\n"},
       {"", "", ""}}};
  if (size < 3) return 0;
  const std::string text(reinterpret_cast<const char*>(data) + 3, size - 3);
  const std::size_t first = text.size() * data[1] / 256,
                    second = first + (text.size() - first) * data[2] / 256;
  const std::array<std::string, 3> parts = {text.substr(0, first), text.substr(first, second - first),
                                            text.substr(second)};
  for (std::size_t k = 0; k < parts.size(); ++k) {
    const std::string whole = kBeginnings[data[0] % kBeginnings.size()][k] + parts[k];
    std::ofstream(scratch.folder() / topside::kControlTables[k], std::ios::binary) << whole;
  }
  fuzz::readsOrRefuses([&] {
    topside::ControlPoints control = topside::readControlPoints(scratch.folder(), "EPSG:32755");
    control.placeAbout(control.firstOnEarth().value_or(Geodetic()));
    for (const auto& point : control.points)
      if ((point.place && !point.place->allFinite()) || (point.place && !(point.sigma.minCoeff() > 0)))
        __builtin_trap();
    for (const auto& bar : control.bars)
      if (!(bar.length > 0) || !(bar.sigma > 0) || bar.from == bar.to) __builtin_trap();
    topside::PairList list{.pairs = {{0, "left/1.png", "right/1.png"}, {1, "2.png", "2r.png"}}};
    for (const auto& sighting : topside::sightingsOf(control, list))
      if (sighting.pair > 1 || !sighting.pixel.allFinite()) __builtin_trap();
  });
  return 0;
}
