#include "scenery.h"

#include <algorithm>

#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit::simulation {
namespace {

using enum FenceKind;

constexpr Fences kOpaque = {kBoards, kWall, kHedge, kHedge, kHedge, kHedge};
constexpr Fences kGardens = {kSlats, kBoards, kHedge, kHedge, kHedge, kRailing};

constexpr Fences all(FenceKind kind) {
  return {kind, kind, kind, kind, kind, kind};
}

constexpr Scenery kTown = {.name = "town",
                           .fences = kOpaque,
                           .lines = {{{.beyond_kerb = 1.9,
                                       .below = 1,
                                       .kinds_an_owner = 997,
                                       .kinds = kOpaque,
                                       .height = {1.5, 2.5},
                                       .joined = false}}}};

constexpr Scenery suburb() {
  Scenery s = kTown;
  s.name = "suburb";
  s.kerb = {3.6, 5.8};
  s.green_below = 0.24, s.urban_above = 0.78;
  s.green_width = {10, 24}, s.villa_width = {15, 26};
  s.other_depth = {20, 32};
  s.gapless = 0.5;
  s.urban_floors = {2, 3};
  s.recessed = 0.5, s.shops = 0.1;
  s.setback = {3, 8}, s.beside = {4, 11};
  s.fences = kGardens;
  s.tall_fences = 0.3;
  s.closed = 0.45;
  s.plants_before = {3, 10}, s.plants_behind = {6, 16};
  s.lines = {{{.beyond_kerb = 1.9,
               .below = 0.6,
               .kinds = kGardens,
               .height = {0.9, 2.2},
               .joined = false}}};
  s.things = {5, 13};
  s.trees = 0.35;
  s.parked = {0.4, 0.9};
  s.far_houses = {0.15, 0.6};
  s.far_floors = {1, 3}, s.far_plants = {4, 14};
  s.far_trees = 0.6;
  s.oncoming_spacing = 120;
  return s;
}

constexpr Scenery village() {
  Scenery s = kTown;
  s.name = "village";
  s.kerb = {3.4, 4.6};
  s.kerb_height = 0.06, s.paving = 1.2;
  s.bank_height = 0.8, s.bank = {2, 14};
  s.side_streets = {90, 200};
  s.side_street_width = {4, 6};
  s.front = 1.0;
  s.open_below = 0.3, s.green_below = 0.42, s.urban_above = kNever;
  s.green_width = {16, 34}, s.villa_width = {22, 38};
  s.other_depth = {26, 40};
  s.villa_floors = {1, 2};
  s.setback = {8, 17}, s.beside = {9, 20};
  s.fences = kGardens;
  s.tall_fences = 0.2;
  s.lines = {
      {{.beyond_kerb = 1.6, .below = 0.5, .owner = 40, .kinds = kGardens, .height = {0.8, 1.7}}}};
  s.verge = 1.7;
  s.things = {10, 28};
  s.posts = 0.05, s.lamps = 0.25, s.signs = 0.1, s.trees = 0.45;
  s.parked = {0.05, 0.3};
  s.wood_above = 0.78, s.wood = {9, 30};
  s.far_houses = {0.02, 0.3};
  s.far_floors = {1, 2}, s.far_plants = {3, 9};
  s.far_trees = 0.8;
  s.oncoming_spacing = 220;
  s.leader = 0.25;
  return s;
}

constexpr Scenery country() {
  Scenery s = kTown;
  s.name = "country";
  s.kerb = {3.4, 3.4};
  s.kerb_height = 0, s.paving = 0;
  s.bank_height = 1.6, s.bank = {1.5, 7};
  s.side_streets = {300, 600};
  s.side_street_width = {3, 4};
  s.front = 6;
  s.open_below = 0.7, s.green_below = kAlways, s.urban_above = kNever;
  s.villa_width = {26, 44}, s.other_depth = {26, 40};
  s.villa_floors = {1, 2};
  s.setback = {6, 14}, s.beside = {12, 24};
  s.fences = kGardens;
  s.tall_fences = 0.2;
  s.lines = {
      {{.beyond_kerb = 3.2, .below = 0.4, .owner = 55, .kinds = all(kHedge), .height = {0.8, 2.4}},
       {.beyond_kerb = 5.5,
        .below = 0.45,
        .owner = 90,
        .kinds = all(kPasture),
        .height = {1.1, 1.3}}}};
  s.verge = 2.2;
  s.things = {12, 40};
  s.posts = 0.4, s.lamps = 0, s.signs = 0.08, s.trees = 0.5;
  s.parked = {};
  s.wood_above = 0.62, s.wood = {7, 36};
  s.far_houses = {0, 0.06};
  s.far_floors = {1, 2}, s.far_plants = {0, 3};
  s.far_trees = 0.7;
  s.oncoming_spacing = 250;
  s.oncoming_speed = {14, 24};
  s.leader = 0.2, s.trucks = 2;
  return s;
}

constexpr Scenery motorway() {
  Scenery s = kTown;
  s.name = "motorway";
  s.oncoming = 8.4;
  s.kerb = {6.2, 6.2};
  s.kerb_height = 0, s.paving = 0;
  s.bank_height = 5, s.bank = {3, 15};
  s.side_streets = {};
  s.open_below = kNever;
  s.lines = {{{.beyond_kerb = 0.5,
               .below = 1,
               .owner = 160,
               .kinds_an_owner = 8,
               .kinds = {kGuardRail, kGuardRail, kGuardRail, kGuardRail, kConcrete, kGuardRail},
               .height = {0.75, 0.85}},
              {.beyond_kerb = -8.9,  // 4.7 m to the left of the lane
               .below = 1,
               .owner = 200,
               .kinds = {kGuardRail, kConcrete, kGuardRail, kConcrete, kConcrete, kGuardRail},
               .height = {0.8, 0.9},
               .left_only = true},
              {.beyond_kerb = 3.4,
               .below = 0.42,
               .owner = 90,
               .kinds_an_owner = 2,
               .kinds = all(kScreen),
               .height = {2.5, 5.5}}}};
  s.verge = 2.6;
  s.things = {22, 60};
  s.boards = 0.25, s.posts = 0.3, s.lamps = 0.15, s.signs = 0.15, s.trees = 0;
  s.parked = {};
  s.wood_above = 0.5, s.wood = {11, 34};
  s.far_houses = {0, 0.15};
  s.far_floors = {1, 3}, s.far_plants = {1, 6};
  s.far_trees = 0.6;
  s.oncoming_spacing = 45;
  s.oncoming_speed = {22, 34};
  s.leader = 0.6, s.trucks = 4;
  return s;
}

constexpr Scenery car_park() {
  Scenery s = kTown;
  s.name = "car-park";
  s.kerb = {3.4, 3.4};
  s.kerb_height = 0;
  s.asphalt = true;
  s.side_streets = {};
  s.front = 37;
  s.open_below = 0.35, s.green_below = kAlways, s.urban_above = kAlways;
  s.urban_width = {18, 45}, s.urban_depth = {16, 30};
  s.gapless = 0.1;
  s.urban_floors = {1, 2};
  s.recessed = 0, s.shops = 0.8;
  s.lines = {{{.beyond_kerb = 36,
               .below = 0.6,
               .owner = 60,
               .kinds = {kHedge, kRailing, kSlats, kHedge, kWall, kHedge},
               .height = {1, 2.2}}}};
  s.verge = 0.6;
  s.things = {14, 34};
  s.lamps = 0.4, s.signs = 0.2, s.trees = 0;
  s.parked = {};
  s.rows = {3.9, 15, 20.2, 31.3};
  s.row_cars = {0, 1};
  s.far_houses = {0.1, 0.5};
  s.far_trees = 0.9;
  s.oncoming_spacing = 120;
  s.oncoming_speed = {2, 5};
  s.leader = 0.3;
  return s;
}

constexpr Scenery old_town() {
  Scenery s = kTown;
  s.name = "old-town";
  s.oncoming = 1;  // one way
  s.kerb = {3.3, 3.3};
  s.kerb_height = 0.04, s.paving = 0.6;
  s.side_streets = {50, 130};
  s.side_street_width = {3, 4.5};
  s.front = 0;
  s.green_below = kAlways, s.urban_above = kAlways;
  s.smallest_width = 4, s.smallest_depth = 5;
  s.urban_width = {6, 13}, s.urban_depth = {9, 14};
  s.gapless = 1;
  s.urban_floors = {3, 5};
  s.recessed = 0.1, s.shops = 0.6;
  s.fences = all(kWall);
  s.lines = {{{.beyond_kerb = 1.2, .below = 1, .kinds = all(kWall), .height = {2.5, 5}}}};
  s.verge = 0.5;
  s.things = {15, 40};
  s.lamps = 0.2, s.signs = 0.3, s.trees = 0;
  s.parked = {};
  s.far_houses = {0.8, 1};
  s.far_floors = {2, 5};
  s.oncoming_spacing = 0;
  s.leader = 0.15;
  return s;
}

constexpr Scenery rows() {
  Scenery s = kTown;
  s.name = "rows";
  s.equal = true;
  s.kerb = {3.4, 3.4};
  s.side_streets = {};
  s.green_below = kAlways, s.urban_above = kNever;
  s.villa_width = {16, 16}, s.other_depth = {18, 18};
  s.villa_floors = {2, 2};
  s.setback = {4, 4}, s.beside = {6, 6};
  s.lines = {};
  s.things = {16, 16};
  s.lamps = 1, s.signs = 0, s.trees = 0;
  s.parked = {};
  s.far_houses = {};
  s.far_plants = {};
  return s;
}

constexpr Scenery off_street(const char* name, Site (*site)(uint64_t), double sensor_height = 0.7) {
  return {.name = name, .site = site, .sensor_height = sensor_height};
}

template <bool irregular, int changed_percent = 0, int sway_tenths = 3>
Site office(uint64_t seed) {
  return make_office(seed, irregular, changed_percent / 100.0, sway_tenths / 10.0);
}

constexpr auto kSceneries = std::to_array<Scenery>(
    {kTown, suburb(), village(), country(), motorway(), car_park(), old_town(), rows(),
     off_street("office", office<false>), off_street("office-irregular", office<true>),
     off_street("office-changed", office<true, 30>),
     off_street("office-carried", office<true, 0, 40>, 1), off_street("floors", make_floors),
     off_street("stairwell", make_stairwell, 1), off_street("garage", make_garage),
     off_street("mine", make_mine), off_street("greenhouse", make_greenhouse),
     off_street("forest", make_forest), off_street("container-yard", make_container_yard)});

}  // namespace

const Scenery& scenery_of(const std::string& surroundings) {
  const auto* const found = std::ranges::find(kSceneries, surroundings, &Scenery::name);
  if (found == kSceneries.end())
    throw UsageError("surroundings: expected one of ", joined(kSceneries, ", ", &Scenery::name),
                     ", found '", surroundings, "'");
  return *found;
}

}  // namespace revisit::simulation
