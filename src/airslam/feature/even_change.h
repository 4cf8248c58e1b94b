// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>

namespace airslam {

// A number at a place along a line, 0 at its start and 1 at its end.
struct PlacedValue {
  double place = 0;
  double value = 0;
};

// A number that changes evenly along a line.
struct EvenChange {
  double at_start = 0;
  double at_end = 0;

  double At(double place) const { return at_start + place * (at_end - at_start); }
};

// Least squares. At least two of the places differ.
inline EvenChange FitEvenChange(std::span<const PlacedValue> values) {
  double n = 0, place = 0, value = 0;
  for (const PlacedValue& v : values) {
    n += 1;
    place += v.place;
    value += v.value;
  }
  place /= n;
  value /= n;
  double square = 0, product = 0;
  for (const PlacedValue& v : values) {
    square += (v.place - place) * (v.place - place);
    product += (v.place - place) * (v.value - value);
  }
  const double slope = product / square;
  return {value - slope * place, value + slope * (1 - place)};
}

}  // namespace airslam
