"""Components of generated scenes: floor plans, walls, furniture, textures and light."""
