"""The evolutionary search: what varies, how a design is scored, the front, the study."""
