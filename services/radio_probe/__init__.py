"""What radios measure, with time and place: devices of many kinds, joined to where the train was, and the weather."""
