#include "recon/topside/report/html_text.hpp"

#include <cmath>

#include "realtime/kernel/text.hpp"

namespace fathom::topside {
namespace {

constexpr const char* kStyle =
    R"(body{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:72rem;padding:0 1rem;color:#1b2733}
h1{font-size:1.5rem}h2{font-size:1.15rem;margin-top:2rem}figure{margin:1rem 0;display:inline-block;vertical-align:top}
figcaption{max-width:34rem;color:#4a5a68}svg{max-width:100%;height:auto}
table{border-collapse:collapse;margin:.5rem 0}td,th{border:1px solid #cfd8e0;padding:.2rem .7rem;text-align:left}td.n{text-align:right}
.good{color:#1f6f43}.bad{color:#b3261e;font-weight:600})";

}  // namespace

std::string fixedDigits(double value, int digits) {
  return std::isfinite(value) ? decimals(value, digits) : "-";
}

std::string htmlHead(const std::string& title) {
  const std::string safe = markupText(title);
  return "<!doctype html><html lang=en><meta charset=utf-8><title>" + safe + "</title><style>" + kStyle +
         "</style>\n<h1>" + safe + "</h1>\n";
}

std::string htmlRow(const std::string& name, const std::string& value) {
  return "<tr><td>" + markupText(name) + "</td><td class=n>" + markupText(value) + "</td></tr>\n";
}

}  // namespace fathom::topside
