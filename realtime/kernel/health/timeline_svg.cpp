#include "realtime/kernel/health/timeline_svg.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "realtime/kernel/text.hpp"

namespace fathom::rt {
namespace {

// Sizes of the picture [px].
constexpr double kWidth = 1600, kMargin = 24, kGutter = 190, kBar = 20, kBarGap = 3, kRowGap = 16;
constexpr double kTitle = 56, kAxis = 30, kPanelGap = 26, kLegendLine = 20, kLegendHead = 30;
constexpr double kNarrowest = 1.2;  // a stage that lasts a microsecond is still seen
constexpr double kLetter = 6.2;     // width of a letter of the labels
constexpr double kPlotRight = kWidth - kMargin, kPlotLeft = kMargin + kGutter;
constexpr double kNsPerMs = 1e6;
// The second panel: a frame with something around it, not so long that a cycle of 0.1 ms is no longer seen.
// The third: one cycle of the loop.
constexpr std::int64_t kShortestZoomNs = 20'000'000, kLongestZoomNs = 250'000'000;
constexpr std::int64_t kShortestCycleNs = 200'000;

// Hues that stay apart from one another; dark ones carry white letters, light ones black.
struct Colour {
  const char* fill;
  const char* letters;
};
constexpr std::array<Colour, 12> kColours{{{"#4477aa", "#fff"},
                                           {"#ee6677", "#fff"},
                                           {"#228833", "#fff"},
                                           {"#ccbb44", "#222"},
                                           {"#66ccee", "#222"},
                                           {"#aa3377", "#fff"},
                                           {"#ee8866", "#222"},
                                           {"#44bb99", "#222"},
                                           {"#7766bb", "#fff"},
                                           {"#aaddff", "#222"},
                                           {"#bbcc33", "#222"},
                                           {"#886600", "#fff"}}};
const char* const kLate = "#cc0000";

std::string duration(std::int64_t ns) {
  const auto value = static_cast<double>(ns);
  constexpr double kUs = 1e3, kMs = 1e6, kS = 1e9;
  if (value < kMs) return formatted("%.*f us", value < 100 * kUs ? 1 : 0, value / kUs);
  if (value < kS) return formatted("%.*f ms", value < 100 * kMs ? 1 : 0, value / kMs);
  return formatted("%.2f s", value / kS);
}

struct Placed {
  TimelineEvent event;
  std::size_t depth = 0;  // stages around this one
};

// Longer stages that hold shorter ones come first, one line higher.
std::vector<Placed> nested(std::vector<TimelineEvent> events) {
  std::sort(events.begin(), events.end(), [](const TimelineEvent& a, const TimelineEvent& b) {
    return a.begin_ns != b.begin_ns ? a.begin_ns < b.begin_ns : a.end_ns > b.end_ns;
  });
  std::vector<Placed> placed;
  std::vector<std::int64_t> open;  // ends of the stages around
  for (const TimelineEvent& event : events) {
    while (!open.empty() && open.back() <= event.begin_ns) open.pop_back();
    placed.push_back({event, open.size()});
    open.push_back(event.end_ns);
  }
  return placed;
}

struct Lane {
  const TimelineRow* row = nullptr;
  std::vector<Placed> stages;
  std::size_t depth = 1;
  std::size_t first_colour = 0;
  [[nodiscard]] double height() const {
    return std::max(static_cast<double>(depth) * (kBar + kBarGap), 2 * (kBar - kBarGap));
  }
  [[nodiscard]] const Colour& colour(std::size_t stage) const {
    return kColours.at((first_colour + stage) % kColours.size());
  }
  [[nodiscard]] std::string stageName(std::size_t stage) const {
    return stage < row->stages.size() ? row->stages[stage].name : "stage " + std::to_string(stage);
  }
};

std::vector<Lane> lanesOf(const TimelinePicture& picture) {
  std::vector<Lane> lanes;
  std::size_t colour = 0;
  for (const TimelineRow& row : picture.rows) {
    Lane lane;
    lane.row = &row;
    lane.stages = nested(row.events);
    for (const Placed& stage : lane.stages) lane.depth = std::max(lane.depth, stage.depth + 1);
    lane.first_colour = colour;
    colour += row.stages.size();
    lanes.push_back(std::move(lane));
  }
  return lanes;
}

double panelHeight(const std::vector<Lane>& lanes) {
  double height = kAxis;
  for (const Lane& lane : lanes) height += lane.height() + kRowGap;
  return height;
}

// The first deadline at or after `from`.
std::int64_t firstDeadline(const TimelineRow& row, std::int64_t from) {
  const std::int64_t phase = ((row.deadline_ns - from) % row.period_ns + row.period_ns) % row.period_ns;
  return from + phase;
}

// A cycle that ran past its next deadline.
bool late(const TimelineRow& row, const TimelineEvent& e) {
  return row.period_ns > 0 && e.end_ns > firstDeadline(row, e.begin_ns + 1);
}

// A step of 1, 2 or 5 times a power of ten that gives some ten marks.
std::int64_t axisStep(std::int64_t span_ns) {
  constexpr double kMarks = 12;
  const double rough = static_cast<double>(span_ns) / kMarks;
  const double decade = std::pow(10.0, std::floor(std::log10(std::max(rough, 1.0))));
  for (const double factor : {1.0, 2.0, 5.0})
    if (factor * decade >= rough) return std::llround(factor * decade);
  return std::llround(10 * decade);
}

class Panel {
 public:
  Panel(const TimelinePicture& picture, const std::vector<Lane>& lanes, std::int64_t from, std::int64_t to,
        double top)
      : origin_(picture.from_ns), lanes_(lanes), from_(from), to_(to), top_(top) {}

  std::string draw() const {
    std::string svg = axis();
    double y = top_ + kAxis;
    for (const Lane& lane : lanes_) {
      svg += background(lane, y) + deadlines(lane, y) + bars(lane, y);
      y += lane.height() + kRowGap;
    }
    return svg;
  }

  [[nodiscard]] double x(std::int64_t ns) const {
    const double share = static_cast<double>(ns - from_) / static_cast<double>(to_ - from_);
    return kPlotLeft + std::clamp(share, 0.0, 1.0) * (kPlotRight - kPlotLeft);
  }
  [[nodiscard]] double bottom() const { return top_ + panelHeight(lanes_); }

 private:
  std::string axis() const {
    std::string svg;
    const double bottom = top_ + panelHeight(lanes_) - kRowGap / 2;
    const std::int64_t step = axisStep(to_ - from_);
    const std::int64_t first = (from_ - origin_ + step - 1) / step * step;
    for (std::int64_t t = first; t <= to_ - origin_; t += step) {
      const double at = x(origin_ + t);
      svg += formatted("<line class='grid' x1='%.1f' x2='%.1f' y1='%.1f' y2='%.1f'/>", at, at, top_ + 18,
                       bottom);
      svg += formatted("<text class='axis' x='%.1f' y='%.1f' text-anchor='middle'>%g</text>", at, top_ + 12,
                       static_cast<double>(t) / kNsPerMs);
    }
    svg += formatted("<text class='axis' x='%.1f' y='%.1f'>time, ms</text>\n", kMargin, top_ + 12);
    return svg;
  }

  std::string background(const Lane& lane, double y) const {
    std::string svg = formatted("<rect class='lane' x='%.1f' y='%.1f' width='%.1f' height='%.1f'/>",
                                kPlotLeft, y - 4, kPlotRight - kPlotLeft, lane.height() + 8);
    svg += formatted("<text class='name' x='%.1f' y='%.1f'>%s</text>", kMargin, y + 13,
                     markupText(lane.row->name).c_str());
    svg += formatted("<text class='note' x='%.1f' y='%.1f'>%s</text>\n", kMargin, y + 29,
                     markupText(lane.row->note).c_str());
    return svg;
  }

  std::string deadlines(const Lane& lane, double y) const {
    std::string svg;
    if (lane.row->period_ns <= 0) return svg;
    for (std::int64_t t = firstDeadline(*lane.row, from_); t <= to_; t += lane.row->period_ns)
      svg += formatted("<line class='due' x1='%.2f' x2='%.2f' y1='%.1f' y2='%.1f'/>", x(t), x(t), y - 4,
                       y + lane.height() + 4);
    return svg + "\n";
  }

  std::string bars(const Lane& lane, double y) const {
    std::string svg;
    for (const Placed& placed : lane.stages) {
      const TimelineEvent& e = placed.event;
      if (e.end_ns < from_ || e.begin_ns > to_) continue;
      const double left = x(e.begin_ns), width = std::max(x(e.end_ns) - left, kNarrowest);
      const double top = y + static_cast<double>(placed.depth) * (kBar + kBarGap);
      const std::string name = markupText(lane.stageName(e.stage));
      svg += formatted("<rect x='%.2f' y='%.1f' width='%.2f' height='%.1f' rx='%.1f' fill='%s'>", left, top,
                       width, kBar, width > 6 ? 2.0 : 0.0, lane.colour(e.stage).fill);
      svg += "<title>" + name + " " + duration(e.end_ns - e.begin_ns) + "</title></rect>";
      if (static_cast<double>(name.size()) * kLetter + 8 < width)
        svg += formatted("<text class='bar' x='%.1f' y='%.1f' style='fill:%s'>%s</text>", left + 4, top + 14,
                         lane.colour(e.stage).letters, name.c_str());
      const bool late =
          placed.depth == 0 && lane.row->period_ns > 0 && e.end_ns > firstDeadline(*lane.row, e.begin_ns + 1);
      if (late)
        svg += formatted("<path d='M%.1f %.1f l-5 -7 h10 z' fill='%s'/>", left + width, top - 1, kLate);
    }
    return svg + "\n";
  }

  std::int64_t origin_;
  const std::vector<Lane>& lanes_;
  std::int64_t from_, to_;
  double top_;
};

struct Span {
  std::int64_t from = 0, to = 0;
};

// A span of `length` with `begin` at a tenth of it, within the picture.
Span spanAt(const TimelinePicture& picture, std::int64_t begin, std::int64_t length) {
  constexpr std::int64_t kLead = 10;
  const std::int64_t from =
      std::clamp(begin - length / kLead, picture.from_ns, std::max(picture.from_ns, picture.to_ns - length));
  return {from, from + length};
}

// What the second panel enlarges: a cycle that ran late, else the longest stage of the rows without a period.
Span zoomSpan(const TimelinePicture& picture) {
  constexpr std::int64_t kThirds = 3;
  const std::int64_t most = std::min((picture.to_ns - picture.from_ns) / kThirds, kLongestZoomNs);
  TimelineEvent shown;
  for (const TimelineRow& row : picture.rows)
    for (const TimelineEvent& e : row.events)
      if (row.period_ns == 0 && e.end_ns - e.begin_ns > shown.end_ns - shown.begin_ns) shown = e;
  for (const TimelineRow& row : picture.rows)
    for (const TimelineEvent& e : row.events)
      if (late(row, e)) shown = e;
  const std::int64_t wanted = (shown.end_ns - shown.begin_ns) * 4 / 3;
  return spanAt(picture, std::max(shown.begin_ns, picture.from_ns),
                std::clamp(wanted, std::min(kShortestZoomNs, most), most));
}

// The periodic row's lane for the third panel, and its first whole cycle within `zoom`; nullptr where there
// is none.
const Lane* cycleIn(const std::vector<Lane>& lanes, const Span& zoom, Span& cycle) {
  for (const Lane& lane : lanes)
    for (const Placed& placed : lane.stages)
      if (lane.row->period_ns > 0 && placed.depth == 0 && placed.event.begin_ns > zoom.from &&
          placed.event.end_ns < zoom.to) {
        const std::int64_t due = firstDeadline(*lane.row, placed.event.begin_ns) - lane.row->period_ns;
        const std::int64_t length = std::max((placed.event.end_ns - due) * 6 / 5, kShortestCycleNs);
        cycle = {due - length / 10, due + length};
        return &lane;
      }
  return nullptr;
}

// What of `above` the panel below it shows.
std::string funnel(double left, double right, double bottom, double below) {
  return formatted("<path class='zoom' d='M%.1f %.1f L%.1f %.1f H%.1f L%.1f %.1f Z'/>\n", left, bottom,
                   kPlotLeft, below + 18, kPlotRight, right, bottom);
}

std::string shade(double left, double right, double top, double bottom) {
  return formatted("<rect class='zoom' x='%.2f' y='%.1f' width='%.2f' height='%.1f'/>", left, top + 18,
                   std::max(right - left, 1.0), bottom - top - 18);
}

std::string legend(const std::vector<Lane>& lanes, double top) {
  constexpr std::size_t kColumns = 3;
  constexpr double kColumn = (kWidth - 2 * kMargin) / kColumns;
  std::vector<double> heights(kColumns, 0.0);
  std::string svg;
  for (const Lane& lane : lanes) {
    const auto column =
        static_cast<std::size_t>(std::min_element(heights.begin(), heights.end()) - heights.begin());
    const double left = kMargin + static_cast<double>(column) * kColumn;
    double y = top + heights[column] + 14;
    svg += formatted("<text class='name' x='%.1f' y='%.1f'>%s</text>", left, y,
                     markupText(lane.row->name).c_str());
    const std::array<std::pair<const char*, double>, 4> heads{
        {{"p50", 280}, {"p99", 350}, {"max", 420}, {"late", 470}}};
    for (const auto& [text, offset] : heads)
      svg += formatted("<text class='axis' x='%.1f' y='%.1f' text-anchor='end'>%s</text>", left + offset, y,
                       text);
    for (std::size_t stage = 0; stage < lane.row->stages.size(); ++stage) {
      const StageSummary& s = lane.row->stages[stage];
      y += kLegendLine;
      svg += formatted("<rect x='%.1f' y='%.1f' width='12' height='12' rx='2' fill='%s'/>", left, y - 11,
                       lane.colour(stage).fill);
      svg += formatted("<text class='key' x='%.1f' y='%.1f'>%s</text>", left + 18, y,
                       markupText(s.name).c_str());
      const std::array<std::pair<std::string, double>, 4> values{{{duration(s.p50_ns), 280},
                                                                  {duration(s.p99_ns), 350},
                                                                  {duration(s.max_ns), 420},
                                                                  {std::to_string(s.misses), 470}}};
      for (const auto& [text, offset] : values)
        svg += formatted("<text class='key' x='%.1f' y='%.1f' text-anchor='end'>%s</text>", left + offset, y,
                         text.c_str());
    }
    svg += '\n';
    heights[column] += kLegendHead + kLegendLine * static_cast<double>(lane.row->stages.size());
  }
  return svg;
}

double legendHeight(const std::vector<Lane>& lanes) {
  // As legend() fills its three columns, whatever the order: no more than all in one.
  constexpr std::size_t kColumns = 3;
  std::array<double, kColumns> heights{};
  for (const Lane& lane : lanes)
    *std::min_element(heights.begin(), heights.end()) +=
        kLegendHead + kLegendLine * static_cast<double>(lane.row->stages.size());
  return *std::max_element(heights.begin(), heights.end());
}

}  // namespace

std::string timelineSvg(const TimelinePicture& picture) {
  TimelinePicture p = picture;
  p.to_ns = std::max(p.to_ns, p.from_ns + 1);
  const std::vector<Lane> lanes = lanesOf(p);

  double y = kTitle;
  const Panel whole(p, lanes, p.from_ns, p.to_ns, y);
  std::string body = whole.draw();
  y = whole.bottom() + kPanelGap;
  if (p.to_ns - p.from_ns > 2 * kShortestZoomNs) {
    const Span zoom = zoomSpan(p);
    const Panel second(p, lanes, zoom.from, zoom.to, y);
    body += shade(whole.x(zoom.from), whole.x(zoom.to), kTitle, whole.bottom());
    body += funnel(whole.x(zoom.from), whole.x(zoom.to), whole.bottom(), y) + second.draw();
    y = second.bottom() + kPanelGap;
    Span cycle;
    if (const Lane* lane = cycleIn(lanes, zoom, cycle)) {
      const std::vector<Lane> one{*lane};
      const Panel third(p, one, cycle.from, cycle.to, y);
      body += funnel(second.x(cycle.from), second.x(cycle.to), second.bottom(), y) + third.draw();
      y = third.bottom() + kPanelGap;
    }
  }
  body += legend(lanes, y);
  const double height = y + legendHeight(lanes) + kMargin;

  std::string svg = formatted(
      "<svg xmlns='http://www.w3.org/2000/svg' width='%.0f' height='%.0f' viewBox='0 0 %.0f %.0f'>\n", kWidth,
      height, kWidth, height);
  svg +=
      "<style>text{font-family:'DejaVu Sans',sans-serif;font-size:12px;fill:#222}.title{font-size:20px;"
      "font-weight:bold}.name{font-weight:bold;font-size:13px}.note,.axis{font-size:11px;fill:#667}"
      ".bar{font-size:10.5px}.lane{fill:#f4f6f9}.grid{stroke:#d5dae2;stroke-width:1}"
      ".due{stroke:#223;stroke-width:.7;stroke-dasharray:2 3;opacity:.55}.zoom{fill:#4477aa;opacity:.10}"
      "</style>\n<rect width='100%' height='100%' fill='#fff'/>\n";
  svg += formatted("<text class='title' x='%.1f' y='34'>%s</text>\n", kMargin, markupText(p.title).c_str());
  return svg + body + "</svg>\n";
}

TimelineRow timelineRow(std::string name, std::string note, StageTimes& times, const TimelineTrack& track,
                        std::int64_t now_ns, std::int64_t duration_ns) {
  TimelineRow row;
  row.name = std::move(name);
  row.note = std::move(note);
  StageTimes::Snapshot snapshot;
  if (times.read(snapshot)) row.stages.assign(snapshot.all().begin(), snapshot.all().end());
  row.events = track.copy(now_ns - duration_ns, now_ns);
  return row;
}

}  // namespace fathom::rt
