"""The paper as settings: items with the published values, pipelines, recordings; and what judges them."""
