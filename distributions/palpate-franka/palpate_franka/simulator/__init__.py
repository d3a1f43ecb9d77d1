"""franky-sim's arm over palpate's specimen, with palpate's SensONE at its flange."""
